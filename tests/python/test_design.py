"""What to drive next, from Python and from the command."""

import json
import subprocess

import pytest
import wheelstate


@pytest.fixture(scope="module")
def ride():
    """Straight up a ramp and down again: nothing turns."""
    return wheelstate.simulate("wheelchair", "climb", seed=3)


@pytest.fixture(scope="module")
def plan(ride):
    return wheelstate.design("wheelchair", ride, interest=["chair.yaw_inertia"], draws=7, seed=5)


def test_the_plan_names_the_drive_that_turns_and_its_fit_has_the_promised_error(ride, plan):
    best = plan.best
    assert plan.helps and best is not None and best.scenario == "identification" and plan.probability == pytest.approx(0.75)
    now = plan.parameters["chair.yaw_inertia"]
    assert not now.identified and now.unit == "kg.m2" and now.supposed is not None
    promise = best.promises["chair.yaw_inertia"]
    assert promise is not None and promise.low < promise.std_error < promise.high and promise.by_noise <= promise.std_error
    driven = wheelstate.simulate("wheelchair", best.scenario, seed=77)
    fit = wheelstate.fit("wheelchair", [ride, driven])
    assert promise.low <= fit["chair.yaw_inertia"].std_error <= promise.high
    assert [repeat.times for repeat in plan.repeats] == [2, 4] and plan.repeats[0].duration == 2 * best.duration


def test_the_plan_shows_itself_and_has_the_commands_to_drive(plan):
    assert "drive next: identification" in str(plan) and "drive next" in plan._repr_html_() and "identification" in repr(plan)
    assert plan.inputs is not None and sorted(plan.inputs) == ["drive_force", "drive_moment", "time"]
    assert plan.to_dict()["candidates"][0]["scenario"] == "identification" and "supposed within" in "".join(plan.notes)


def test_the_command_makes_the_same_plan(ride, plan, command, tmp_path):
    ride.write(tmp_path / "ride.csv")
    words = "design wheelchair ride.csv --for chair.yaw_inertia --draws 7 --seed 5 --json --out plan.csv".split()
    done = subprocess.run([command, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert [c["scenario"] for c in told["candidates"]] == [c.scenario for c in plan.candidates]
    assert told["candidates"][0]["promises"][0]["std_error"] == pytest.approx(plan.candidates[0].promises["chair.yaw_inertia"].std_error)
    assert (tmp_path / "plan.csv").read_text().startswith("time,drive_force,drive_moment")


def test_what_cannot_be_designed_is_refused_in_one_line(ride):
    with pytest.raises(wheelstate.Error, match="human-dynamics: .* no manoeuvre"):
        wheelstate.design("human-dynamics")
    with pytest.raises(wheelstate.Error, match="--for chair.yaw_inertie: .* did you mean chair.yaw_inertia"):
        wheelstate.design("wheelchair", ride, interest=["chair.yaw_inertie"])
    with pytest.raises(wheelstate.Error, match="--limit plant.effort: 2..1 is no range"):
        wheelstate.design("wheelchair", ride, limit={"plant.effort": (2.0, 1.0)})
