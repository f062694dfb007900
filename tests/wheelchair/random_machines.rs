//! The wheelchair's estimator with chairs, slopes and samples that nobody chose.

use super::runs::{NOMINAL, Normal, inputs, parameters};
use std::f64::consts::PI;
use wheelstate::estimator::wheelchair::{Inputs, Kind, Model, Outputs, Parameters, Wheelchair};
use wheelstate::plant::wheelchair::{Actuation, Body, Course, Plant, Ramp, Sensors};
use wheelstate::variable::Kind as Type;
use wheelstate::{Estimator, Status, Variables};

const KINDS: [Kind; 4] = [Kind::Basic, Kind::Bias, Kind::AccelerationInput, Kind::GravityVector];
const COURSES: [Course; 3] = [Course::Climb, Course::Oblique, Course::YawMoment];

/// A chair like others: user, geometry, friction, wheels and the place of the sensor differ.
fn some_chair(normal: &mut Normal) -> Parameters {
    let mut p = Parameters::default();
    let mut vary = |value: &mut f64, share: f64| *value *= 1.0 + share * normal.uniform();
    let chair = &mut p.chair;
    vary(&mut chair.mass, 0.5);
    vary(&mut chair.yaw_inertia, 0.5);
    vary(&mut chair.com_ahead, 0.7);
    vary(&mut chair.drag, 0.9);
    vary(&mut chair.yaw_drag, 0.9);
    vary(&mut chair.wheel_radius, 0.4);
    vary(&mut chair.reference_to_right, 0.6);
    vary(&mut chair.reference_to_left, 0.6);
    chair.wheel_inertia = 0.05 * (1.0 + normal.uniform());
    chair.yaw_friction = 0.5 * (1.0 + normal.uniform());
    p.rolling.coefficient = 0.01 * (1.0 + normal.uniform());
    (p.imu.x, p.imu.y, p.imu.z) = (0.3 * normal.uniform(), 0.2 * normal.uniform(), 0.5 * normal.uniform());
    p.encoder.counts_body_pitch = normal.uniform() > 0.0;
    p
}

fn body(p: &Parameters) -> Body {
    let chair = &p.chair;
    Body {
        mass: chair.mass,
        yaw_inertia: chair.yaw_inertia,
        com_ahead: chair.com_ahead,
        drag: chair.drag,
        yaw_drag: chair.yaw_drag,
        yaw_friction: chair.yaw_friction,
        rolling_coefficient: p.rolling.coefficient,
        smoothing_speed: p.rolling.smoothing_speed,
        smoothing_yaw_rate: p.rolling.smoothing_yaw_rate,
        wheel_radius: chair.wheel_radius,
        wheel_inertia: chair.wheel_inertia,
        track: chair.reference_to_right + chair.reference_to_left,
        imu: [p.imu.x, p.imu.y, p.imu.z],
        gravity: p.gravity,
    }
}

/// Between the edges of the ramp, which are no white noise, the errors are as large as they are said to be:
/// for any chair, heading and slope, with regular and irregular steps. The largest of all runs counts.
#[test]
fn errors_keep_to_their_standard_deviations() {
    for kind in KINDS {
        let mut worst = [0.0_f64; 5];
        for seed in 0..90 {
            let mut normal = Normal::new(seed);
            let mut p = some_chair(&mut normal);
            p.filter.kind = kind;
            p.filter.detect_standstill = seed % 2 == 0;
            let course = COURSES[seed as usize % 3];
            let heading = PI * normal.uniform();
            p.initial.slope = p.initial.slope_std * normal.draw();
            p.initial.heading = if kind == Kind::GravityVector { PI * normal.uniform() } else { heading };
            let ramp = Ramp { slope: 0.12 * normal.uniform(), ..course.ramp() };
            let sensors = Sensors { encoder_on_frame: p.encoder.counts_body_pitch, ..Sensors::default() };
            let mut plant = Plant::new(body(&p), ramp, Actuation::default(), sensors, heading);
            let mut estimator = Wheelchair::new(&p).unwrap();
            let (mut outputs, mut dt) = (Outputs::default(), 0.01);
            let (mut squares, mut count, mut on_slope) = ([0.0; 5], 0.0, 0.0);
            while plant.time() < 10.0 {
                let command = course.command(plant.time(), plant.truth().speed);
                let reading = plant.measure(command, &NOMINAL.draw(&mut normal));
                let status = estimator.step(&inputs(&reading, command), dt);
                assert!(!status.contains(Status::RECOVERED), "{kind:?} seed {seed}: {status}");
                estimator.outputs(&Inputs::default(), 0.0, &mut outputs);
                let at_edge =
                    |t: f64| (ramp.from..ramp.from + 0.6).contains(&t) || (ramp.to..ramp.to + 0.6).contains(&t);
                if plant.time() > 0.5 && !at_edge(plant.time()) {
                    let (t, o) = (plant.truth(), &outputs);
                    // The gravity vector knows no negative slope, and no heading where there is none.
                    let turned = kind == Kind::GravityVector && t.slope < 0.0;
                    let (sign, turn) = if turned { (-1.0, PI) } else { (1.0, 0.0) };
                    let steep = t.slope.abs() > 0.03;
                    let heading = (o.heading.value - t.heading - turn + PI).rem_euclid(2.0 * PI) - PI;
                    let normalised = [
                        (o.speed.value - t.speed) / o.speed.std,
                        (o.yaw_rate.value - t.yaw_rate) / o.yaw_rate.std,
                        (o.slope.value - sign * t.slope) / o.slope.std,
                        (o.pitch.value - t.pitch) / o.pitch.std,
                        if steep { heading / o.heading.std } else { 0.0 },
                    ];
                    (0..5).for_each(|k| squares[k] += normalised[k] * normalised[k]);
                    count += 1.0;
                    on_slope += f64::from(u8::from(steep));
                }
                dt = if seed % 5 == 0 { 0.01 * (1.5 + normal.uniform()) } else { 0.01 };
                plant.advance(command, dt);
            }
            for k in 0..5 {
                let samples: f64 = if k == 4 { on_slope } else { count };
                worst[k] = worst[k].max((squares[k] / samples.max(1.0)).sqrt());
            }
        }
        println!("{kind:?}: largest normalised rms of speed, yaw rate, slope, pitch, heading {worst:.2?}");
        assert!(worst.iter().all(|rms| *rms <= 2.0), "{kind:?}: {worst:.2?}");
    }
}

/// Any number that a declaration allows, many of them at once and at their ends.
fn any_parameters(normal: &mut Normal) -> Parameters {
    let mut p = Parameters::default();
    let mut flat = p.to_vec();
    for (value, variable) in flat.iter_mut().zip(Parameters::declare()) {
        let ((low, high), share) = (variable.range, 0.5 * (normal.uniform() + 1.0));
        let end = normal.uniform();
        if normal.uniform() < 0.4 || !matches!(variable.kind, Type::Real) {
            continue;
        }
        *value = match end {
            end if end < -0.8 => low,
            end if end < -0.6 => high,
            _ if low > 0.0 => low * (high / low).powf(share),
            _ if *value != 0.0 => *value * 10_f64.powf(4.0 * share - 2.0),
            _ => share * high.min(1.0),
        }
        .clamp(low, high);
    }
    p.read(&flat);
    p
}

/// Bursts of missing, infinite, huge and saturated samples, steps of any length and none, any allowed
/// parameters: every output stays a number in its range, and every state can be taken up again.
#[test]
fn nothing_makes_an_output_impossible() {
    let (mut runs, mut recovered, declared) = (0, 0, Outputs::declare());
    for seed in 0..240 {
        let mut normal = Normal::new(seed);
        let course = COURSES[seed as usize % 3];
        let mut p = if seed % 2 == 0 { any_parameters(&mut normal) } else { parameters(course, &mut normal) };
        p.filter.kind = KINDS[seed as usize / 2 % 4];
        let paper = p.filter.kind != Kind::GravityVector && normal.uniform() > 0.0;
        p.filter.model = if paper { Model::Paper } else { Model::Full };
        let Ok(mut estimator) = Wheelchair::new(&p) else { continue };
        runs += 1;
        let mut plant =
            Plant::new(Body::default(), course.ramp(), Actuation::default(), Sensors::default(), course.heading());
        let (mut outputs, mut burst, mut value, mut seen) = (Outputs::default(), 0.0, 0.0, Status::OK);
        while plant.time() < 10.0 {
            let command = course.command(plant.time(), plant.truth().speed);
            let mut sample = inputs(&plant.measure(command, &NOMINAL.draw(&mut normal)), command);
            if burst <= 0.0 && normal.uniform() > 0.97 {
                burst = 50.0 * normal.uniform().abs();
                let poison = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, 39.1 * normal.uniform(), 1e6];
                value = poison[(normal.uniform().abs() * 6.0) as usize % 6];
            }
            if burst > 0.0 {
                burst -= 1.0;
                let mut flat = sample.to_vec();
                flat.iter_mut().filter(|_| normal.uniform() > 0.0).for_each(|input| *input = value);
                sample.read(&flat);
            }
            if normal.uniform() > 0.98 {
                for dt in [0.0, -0.1, f64::NAN, f64::INFINITY, 2.0] {
                    estimator.step(&sample, dt);
                }
                let own = estimator.state().clone();
                estimator.restore(&own).unwrap_or_else(|error| panic!("seed {seed}: own state refused, {error}"));
            }
            let dt = 0.001 + 0.05 * (1.0 + normal.uniform()).powi(2);
            seen |= estimator.step(&sample, dt);
            for ahead in [0.0, 0.03] {
                estimator.outputs(&sample, ahead, &mut outputs);
                for (variable, value) in declared.iter().zip(outputs.to_vec()) {
                    let (low, high) = variable.range;
                    let possible = value.is_finite() && (low..=high).contains(&value);
                    assert!(possible, "seed {seed} {:?}: {} = {value}", p.filter.kind, variable.name);
                }
            }
            plant.advance(command, dt);
        }
        recovered += u32::from(seen.contains(Status::RECOVERED | Status::RESTARTED));
    }
    println!("{runs} runs, of which {recovered} had to start anew and said so");
    assert!(runs > 220);
}
