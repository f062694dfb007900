//! The loader in bends: their geometry, with and without a measured steering angle.

use super::runs::{begun, run};
use crate::support::assert_close;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use wheelstate::Variables;
use wheelstate::estimator::wheel_loader::*;
use wheelstate::model::wheel_loader::{Drive, Loader, Motion, Steering, Unknowns, WheelLoader as Model};

/// Two rigid halves on a joint: the velocities of the joint as both see it are one.
#[test]
fn the_joint_of_an_articulated_machine_has_one_velocity() {
    for (joint, angle, rate, front) in
        [(1.1, 0.4, 0.0, 2.0), (0.7, -0.5, 0.3, 1.5), (1.6, 0.3, -0.4, -2.0), (1.1, 0.6, 0.2, 3.0)]
    {
        let loader = Loader { steering: Steering::Articulated, joint_to_front_axle: joint, ..Loader::default() };
        let paths = loader.paths(angle, rate);
        let rear = paths.gain * front + paths.offset;
        // In the rear half's frame: the front axle's velocity lies along its half, turned by the angle; the rear half's
        // turning rate follows from the joint's sideways velocity and must be the same by both axles.
        let (behind, (sin, cos)) = (loader.wheelbase - joint, f64::sin_cos(angle));
        let turning = (front * sin - joint * rate * cos) / (behind + joint * cos);
        let ahead = turning + rate;
        assert_close("along", front * cos + joint * ahead * sin, rear, 1e-12, 1e-12);
        assert_close("across", front * sin - joint * ahead * cos, behind * turning, 1e-12, 1e-12);
        let step = 1e-6;
        let slope = (loader.paths(angle + step, rate).gain - loader.paths(angle - step, rate).gain) / (2.0 * step);
        assert_close("slope", paths.gain_by_angle, slope, 1e-6, 1e-9);
    }
    let loader = Loader { steering: Steering::FrontSteered, ..Loader::default() };
    assert_close("front-steered", loader.paths(0.4, 0.3).gain, 0.4_f64.cos(), 1e-15, 0.0);
}

/// After a second under constant torque and brake the integrated wheels have the slip that is said of them at once.
#[test]
fn the_steady_slip_is_where_the_wheels_end() {
    for (friction, torque, brake, slope) in
        [(0.75, [1800.0, 900.0], [0.0, 0.0], 0.03), (1e3, [200.0, 300.0], [900.0, 400.0], -0.05)]
    {
        let mut machine = Model::default();
        machine.tire.friction = friction;
        let u = Drive { torque, brake, slope, ..Drive::default() };
        let p = Unknowns::new(19.0, 0.95, 0.45);
        let x = machine.advance(&Motion::new(5.0, 5.0 / 0.55, 5.0 / 0.55), &p, &u, 1.0, 2000);
        let steady = machine.steady_slip(x[0], &p, &u);
        assert_close("acceleration", machine.rates(&x, &p, &u).rates[0], steady.acceleration, 1e-2, 0.0);
        for i in 0..2 {
            let slip = machine.tire.slip(x[0], x[1 + i], 0.55);
            assert_close("slip", steady.demand[i] / p[0], slip, 2e-2, 0.0);
        }
    }
}

/// What the machine below is: `[K, h, lambda]`.
pub const RIGID: [f64; 3] = [24.0, 0.8, 0.55];

/// It drives straight for so long.
pub fn rigid(seconds: f64, seed: u64) -> (Parameters, Vec<Inputs>) {
    bends(Bends::Front(0.0), false, f64::INFINITY, seconds, seed)
}

/// How the path of the front axle differs from that of the rear one.
#[derive(Clone, Copy)]
enum Bends {
    /// By `1/cos` of an angle of so many rad at most.
    Front(f64),
    /// By the articulation angle and its rate.
    Articulated(f64),
}

/// A rigid machine of 3.2 t with a linear tyre, both axles driven, written down here: it accelerates and brakes, and bends
/// for 6 s in every 14 s from `first` on. `known`: its steering angle is measured.
fn bends(kind: Bends, known: bool, first: f64, seconds: f64, seed: u64) -> (Parameters, Vec<Inputs>) {
    let [stiffness, height, share] = RIGID;
    let (mass, wheelbase, radius, rolling, joint) = (3200.0, 2.6, 0.4, 0.02, 1.0);
    let mut p = Parameters::default();
    for (name, value) in [
        ("loader.mass", mass),
        ("loader.wheelbase", wheelbase),
        ("loader.wheel_radius_front", radius),
        ("loader.wheel_radius_rear", radius),
        ("loader.axle_inertia_front", 0.01),
        ("loader.axle_inertia_rear", 0.01),
        ("loader.joint_to_front_axle", joint),
        ("rolling.coefficient", rolling),
        ("tire.friction", 1000.0),
        ("initial.cg_height", 0.9),
        ("initial.cg_ratio", 0.48),
    ] {
        p.set(name, value).unwrap();
    }
    p.loader.steering = match kind {
        _ if !known => Steering::None,
        Bends::Front(_) => Steering::FrontSteered,
        Bends::Articulated(_) => Steering::Articulated,
    };
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |std: f64| {
        let draw: f64 = StandardNormal.sample(&mut random);
        std * draw
    };
    let (mut v, mut samples) = (4.0_f64, Vec::new());
    let weight = mass * 9.80665;
    for k in 0..(100.0 * seconds) as usize {
        let t = 0.01 * k as f64;
        // Half of the force at each axle; it follows the speed, so that this stays where it was.
        let force = rolling * weight + 2600.0 * (0.7 * t).sin() + 800.0 * (4.0 - v);
        let acceleration = (force - rolling * weight) / mass;
        let transfer = mass * acceleration * height / wheelbase;
        let slips =
            [share * weight - transfer, (1.0 - share) * weight + transfer].map(|load| 0.5 * force / (stiffness * load));
        let phase = (t - first).rem_euclid(14.0);
        let bending = t > first && phase < 6.0;
        let shape = std::f64::consts::PI / 6.0;
        let (angle, rate) = if bending { ((shape * phase).sin(), shape * (shape * phase).cos()) } else { (0.0, 0.0) };
        let (angle, front) = match kind {
            Bends::Front(most) => (most * angle, v / (most * angle).cos()),
            Bends::Articulated(most) => {
                let (angle, rate, behind) = (most * angle, most * rate, wheelbase - joint);
                let (sin, cos) = angle.sin_cos();
                (angle, (v * (behind + joint * cos) - joint * behind * rate * sin) / (joint + behind * cos))
            }
        };
        samples.push(Inputs {
            torque_front: 0.5 * force * radius,
            torque_rear: 0.5 * force * radius,
            brake_front: 0.0,
            brake_rear: 0.0,
            slope: 0.0,
            spading_force_x: 0.0,
            spading_force_z: 0.0,
            speed: v + noise(0.02),
            wheel_speed_front: front * (1.0 + slips[0]) / radius + noise(0.03),
            wheel_speed_rear: v * (1.0 + slips[1]) / radius + noise(0.03),
            steering_angle: if known { angle + noise(0.002) } else { f64::NAN },
        });
        v += 0.01 * acceleration;
    }
    (p, samples)
}

const SHARE: f64 = 0.55;

/// Largest error of the share over its standard deviation where it was called healthy, and the share of such samples.
fn judge(outs: &[Outputs]) -> (f64, f64) {
    let healthy: Vec<&Outputs> = outs.iter().filter(|out| out.diagnostics.healthy).collect();
    let score = |out: &&Outputs| ((out.cg_ratio.value - SHARE) / out.cg_ratio.std).abs();
    (healthy.iter().map(score).fold(0.0, f64::max), healthy.len() as f64 / outs.len() as f64)
}

/// A front axle that rolls 0.2 to 10 % farther looks like a load share of 0.1 to 0.4 to whoever takes that for slip.
#[test]
fn a_bend_without_steering_angle_is_detected_and_changes_no_unknown() {
    for seed in 0..4 {
        for most in [0.07, 0.14, 0.26, 0.44] {
            let (p, samples) = bends(Bends::Front(most), false, 20.0, 60.0, seed);
            let outs = run(&mut begun(&p), &samples);
            let (worst, healthy) = judge(&outs[1500..]);
            let seen = outs.iter().filter(|out| out.bend).count();
            let last = &outs[outs.len() - 1];
            println!("{most} rad, seed {seed}: {worst:.1} std, healthy {healthy:.2}, bend {seen}, {:?}", last.cg_ratio);
            assert!(worst < 3.0, "{most} rad, seed {seed}: {worst} standard deviations and healthy");
            // The smallest of these bends is not seen in full, and what is left of it may as well be a late speed.
            assert!((last.cg_ratio.value - SHARE).abs() < 2.0 * last.cg_ratio.std && last.cg_ratio.std < 0.06);
            assert!(healthy > 0.45, "{most} rad, seed {seed}: {healthy}");
            if most > 0.1 {
                assert!((1300..2000).contains(&seen), "{seen} samples of 1800 in three bends");
                assert!(outs.iter().all(|out| !out.bend || (out.hold && !out.diagnostics.healthy)));
            }
        }
    }
}

#[test]
fn a_straight_drive_has_no_bends() {
    for seed in 10..16 {
        let (p, samples) = bends(Bends::Front(0.0), false, 20.0, 60.0, seed);
        assert!(run(&mut begun(&p), &samples).iter().all(|out| !out.bend), "{seed}");
    }
}

/// With the angle both kinds go on learning, and what they learn is right.
#[test]
fn a_measured_steering_angle_takes_the_bend_out_of_the_slip() {
    for seed in 20..24 {
        for kind in [Bends::Front(0.14), Bends::Front(0.44), Bends::Articulated(0.3), Bends::Articulated(0.6)] {
            let (mut p, samples) = bends(kind, true, 4.0, 60.0, seed);
            // A speed that might be late makes the share less certain for a while.
            p.filter.measurement_std.speed_delay = 0.0;
            let outs = run(&mut begun(&p), &samples);
            let (worst, healthy) = judge(&outs[1500..]);
            let held = outs[1500..].iter().filter(|out| out.hold).count();
            let last = &outs[outs.len() - 1];
            println!("seed {seed}: {worst:.1} std, healthy {healthy:.2}, held {held}, {:?}", last.cg_ratio);
            assert!(worst < 3.0 && healthy > 0.95 && held < 200, "seed {seed}: {worst} {healthy} {held}");
            assert!((last.cg_ratio.value - SHARE).abs() < 2.0 * last.cg_ratio.std && last.cg_ratio.std < 0.05);
        }
    }
}

/// Tyres that were changed differ for good: what was learnt of the others is given up.
#[test]
fn paths_that_stay_apart_are_another_machine() {
    let (p, mut samples) = bends(Bends::Front(0.0), false, 20.0, 100.0, 30);
    for inputs in &mut samples[3000..] {
        inputs.wheel_speed_front *= 1.01;
    }
    let outs = run(&mut begun(&p), &samples);
    assert!(outs[3100].bend && outs[3100].hold && !outs[3100].diagnostics.healthy);
    let (worst, _) = judge(&outs[1500..]);
    let last = &outs[outs.len() - 1];
    println!("{worst:.1} std, {:?} {:?}", last.cg_ratio, last.wheel_radius_front);
    assert!(worst < 3.0 && !last.bend && !last.hold);
    assert!((last.cg_ratio.value - SHARE).abs() < 2.0 * last.cg_ratio.std);
    let ratio = last.wheel_radius_front.value / last.wheel_radius_rear.value * 1.01;
    assert!((ratio - 1.0).abs() < 0.003, "{ratio}");
}
