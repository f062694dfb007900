"""Many instances, threads, and loading and unloading the library."""

import threading

import fmpy
from support import Slave, make_log, period


def test_hundred_instances_do_not_touch_each_other(fmu, extracted):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    dt = period(description)
    logs = [make_log(description, rows=12, seed=seed) for seed in range(100)]
    alone = []
    for log in logs[:5]:
        with Slave(folder, description) as slave:
            slave.start()
            for k, row in enumerate(log):
                slave.apply(row)
                slave.step(k * dt, dt)
            alone.append(slave.all_outputs())
    slaves = [Slave(folder, description).start() for _ in logs]
    for k in range(12):
        for slave, log in zip(slaves, logs):
            slave.apply(log[k])
            slave.step(k * dt, dt)
    assert [slave.all_outputs() for slave in slaves[:5]] == alone
    for slave in slaves:
        slave.free()


def test_instances_in_many_threads_do_not_touch_each_other(fmu, extracted):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    dt = period(description)
    log = make_log(description, rows=60, seed=2)
    slaves = [Slave(folder, description).start() for _ in range(4)]
    results = [None] * 4

    def work(i):
        for k, row in enumerate(log):
            slaves[i].apply(row)
            slaves[i].step(k * dt, dt)
        results[i] = slaves[i].all_outputs()

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results[0] is not None and all(result == results[0] for result in results)
    for slave in slaves:
        slave.free()


def test_a_hundred_loads_and_unloads_leave_nothing_behind(fmu, extracted):
    folder = extracted(fmu)
    description = fmpy.read_model_description(folder)
    dt = period(description)
    results = set()
    for _ in range(100):
        with Slave(folder, description) as slave:  # leaving it unloads the library
            slave.start()
            slave.step(0.0, 3 * dt)
            results.add(slave.all_outputs())
    assert len(results) == 1
