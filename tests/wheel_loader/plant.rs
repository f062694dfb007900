//! The loader's plant against mechanics that can be written down by hand.

use crate::support::assert_close;
use wheelstate::plant::road::{Road, class};
use wheelstate::plant::wheel_loader::*;

fn settle(plant: &mut Plant, action: &Action, seconds: f64) {
    for _ in 0..(seconds * 1000.0) as usize {
        plant.advance(action, 1e-3);
    }
}

#[test]
fn loads_carry_the_machine_and_shift_with_acceleration() {
    let machine = Machine { load_sensitivity: 0.0, ..Machine::default() };
    let mut plant = Plant::new(machine, Road::flat(), 1.0);
    let action = Action { torque: [1000.0; 2], ..Action::default() };
    settle(&mut plant, &action, 4.0);
    let before = plant.speed();
    let mut mean = [0.0; 2];
    for _ in 0..1000 {
        plant.advance(&action, 1e-3);
        for (sum, load) in mean.iter_mut().zip(plant.loads()) {
            *sum += load / 1000.0;
        }
    }
    let acceleration = plant.speed() - before;
    let expected = (2000.0 / 0.55 - 0.03 * 4700.0 * 9.80665) / (4700.0 + 72.0 / 0.55f64.powi(2));
    assert_close("acceleration", acceleration, expected, 1e-3, 0.0);
    let weight = 4700.0 * 9.80665;
    assert_close("weight", mean[0] + mean[1], weight, 1e-5, 0.0);
    assert_close("front load", mean[0], 0.45 * weight - 4700.0 * 0.95 / 2.2 * acceleration, 1e-4, 0.0);
}

#[test]
fn the_full_balance_shifts_load_by_the_wheels_own_moments() {
    let mut front = [0.0; 2];
    for (share, front) in [0.0, 1.0].into_iter().zip(&mut front) {
        let mut plant = Plant::new(Machine { wheel_moments: share, ..Machine::default() }, Road::flat(), 2.0);
        let action = Action { torque: [0.03 * 4700.0 * 9.80665 * 0.55 / 2.0; 2], ..Action::default() };
        settle(&mut plant, &action, 4.0);
        *front = plant.loads()[0];
    }
    assert_close("shift", front[1] - front[0], -0.03 * 0.55 / 2.2 * 4700.0 * 9.80665, 2e-2, 0.0);
}

#[test]
fn a_braked_machine_stands_still_on_a_slope() {
    let mut plant = Plant::new(Machine::default(), Road::flat(), 1.0);
    let action = Action { brake: [4000.0; 2], grade: 0.05, ..Action::default() };
    settle(&mut plant, &action, 6.0);
    // The smooth sign lets it creep.
    assert!(plant.speed().abs() < 0.06, "{}", plant.speed());
    let [front, rear] = plant.loads();
    let expected = 0.45 * 0.05f64.cos() - 0.95 / 2.2 * 0.05f64.sin();
    assert_close("front share", front / (front + rear), expected / 0.05f64.cos(), 1e-2, 0.0);
}

#[test]
fn spading_forces_load_the_front_and_hold_back() {
    let mut plant = Plant::new(Machine::default(), Road::flat(), 2.0);
    let torque = (0.03 * (4700.0 * 9.80665 + 2500.0) + 6000.0) * 0.55 / 2.0;
    let action = Action { torque: [torque; 2], spading: [6000.0, 2500.0], ..Action::default() };
    settle(&mut plant, &action, 3.0);
    let [front, rear] = plant.loads();
    let weight = 4700.0 * 9.80665;
    assert_close("sum", front + rear, weight + 2500.0, 1e-3, 0.0);
    assert_close("front", front, 0.45 * weight + 2500.0 * 3.8 / 2.2, 1e-2, 0.0);
}

/// The elevation's variance is the integral of the spectral density, and the slope is its derivative.
#[test]
fn roads_have_the_spectrum_of_their_class() {
    let phases: Vec<f64> = (0..400).map(|i| (i as f64 * 2.399963).rem_euclid(std::f64::consts::TAU)).collect();
    let road = Road::iso8608(class::C, &phases, 0.0, 4000.0);
    let samples: Vec<f64> = (0..390_000).map(|i| road.at(i as f64 * 0.01).0).collect();
    let mean = samples.iter().sum::<f64>() / samples.len() as f64;
    let variance = samples.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / samples.len() as f64;
    let expected = class::C * 0.01 * (1.0 / 0.02 - 1.0 / 3.0);
    assert_close("variance", variance, expected, 0.1, 0.0);
    for i in 0..1000 {
        let x = 1.0 + 0.537 * i as f64;
        let numeric = (road.at(x + 1e-5).0 - road.at(x - 1e-5).0) / 2e-5;
        assert_close("slope", road.at(x).1, numeric, 1e-4, 1e-6);
    }
}
