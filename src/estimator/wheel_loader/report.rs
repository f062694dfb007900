//! What the belief says about the machine now and a little ahead.

use super::engine::{Engine, STATES};
use super::{Inputs, Outputs, Status, WheelLoader};
use crate::filter::gaussian::FactoredGaussian;
use crate::filter::square_root::std_of;
use crate::model::wheel_loader::{Drive, Driven, GRAVITY, Motion, Unknowns, WheelLoader as Machine};
use nalgebra::{SVector, Vector3};

impl WheelLoader {
    /// Conditions that follow from the belief alone.
    pub(super) fn report_status(&self) -> Status {
        let mut status = Status::OK;
        let unknowns = self.engine.unknowns(&self.state.belief.mean);
        status.raise_if(!self.height_observable(&unknowns), Status::UNOBSERVABLE);
        status.raise_if(self.engine.map.at_bound(&unknowns), Status::AT_BOUND);
        if !self.state.supervision.held {
            let (machine, motion) = self.machine_and_motion();
            let driven = Driven::new(&machine, &self.state.drive);
            status.raise_if(driven.lifts(&motion, &unknowns), Status::LIFT_OFF);
        }
        status
    }

    fn machine_and_motion(&self) -> (Machine, Motion) {
        let mean = &self.state.belief.mean;
        (self.engine.corrected([mean[6], mean[7]]), Motion::new(mean[0], mean[1], mean[2]))
    }

    fn height_observable(&self, unknowns: &Unknowns) -> bool {
        let model = self.engine.model_std(unknowns);
        reported_std_of(1, &self.engine, &self.state.belief, unknowns, &model) < 0.5 * self.engine.start_std[1]
    }

    /// Fills the outputs, the motion carried `ahead` seconds forward with `inputs` held.
    pub(super) fn report(&self, inputs: &Inputs, ahead: f64, out: &mut Outputs) {
        let (state, engine) = (&self.state, &self.engine);
        let held = state.supervision.held;
        let unknowns = engine.unknowns(&state.belief.mean);
        let std = reported_std(engine, &state.belief, &unknowns);
        let (machine, mut motion) = self.machine_and_motion();
        let (drive, _) = self.drive(inputs, &mut Status::default());
        if state.started && !held && ahead > 0.0 && ahead.is_finite() {
            let substeps = (ahead / 0.005).ceil().clamp(1.0, 1000.0) as u32;
            let moved = machine.advance(&motion, &unknowns, &drive, ahead, substeps);
            if moved.iter().all(|value| value.is_finite()) {
                motion = moved;
            }
        }

        out.slip_stiffness = unknowns[0];
        out.slip_stiffness_std = std[0];
        out.cg_height = unknowns[1];
        out.cg_height_std = std[1];
        out.cg_ratio = unknowns[2];
        out.cg_ratio_std = std[2];
        out.cg_to_rear_axle = unknowns[2] * machine.loader.wheelbase;
        out.cg_to_rear_axle_std = std[2] * machine.loader.wheelbase;
        out.wheel_radius_front = machine.loader.wheel_radius_front;
        out.wheel_radius_rear = machine.loader.wheel_radius_rear;
        out.wheel_radius_front_std = engine.machine.loader.wheel_radius_front * std_of(&state.belief.factor, 6);
        out.wheel_radius_rear_std = engine.machine.loader.wheel_radius_rear * std_of(&state.belief.factor, 7);
        out.speed_estimate = motion[0];
        out.speed_estimate_std = std_of(&state.belief.factor, 0);
        let standing = !state.started || (held && motion[0].abs() < self.parameters.hold.resume_speed);
        (out.load_ratio, out.load_ratio_std) =
            load_ratio(engine, &state.belief, &machine, &motion, &unknowns, &drive, standing);
        out.hold = held;
        out.cg_height_observable = self.height_observable(&unknowns);
        out.slip_inconsistent = state.supervision.evidence.contradicts;
        out.nis = state.nis;
        out.log_likelihood = state.log_likelihood;
        out.status = state.status;
        let limit = self.parameters.hold.samples.max(0) as u32;
        out.healthy = state.started
            && state.supervision.lost <= limit
            && state.supervision.stale <= limit
            && !state.supervision.evidence.contradicts
            && std[2] <= self.parameters.healthy_std;
    }
}

/// Standard deviations of `[K, h, lambda]`.
fn reported_std(engine: &Engine, belief: &FactoredGaussian<STATES>, unknowns: &Unknowns) -> Vector3<f64> {
    let model = engine.model_std(unknowns);
    Vector3::from_fn(|i, _| reported_std_of(i, engine, belief, unknowns, &model))
}

/// Standard deviation of one unknown: the filter's and the model's. An unknown at the end of its range is
/// known no better than at the start.
fn reported_std_of(
    i: usize,
    engine: &Engine,
    belief: &FactoredGaussian<STATES>,
    unknowns: &Unknowns,
    model: &Vector3<f64>,
) -> f64 {
    let slope = engine.map.slope_of(i, unknowns[i]);
    let variance = slope * slope * std_of(&belief.factor, 3 + i).powi(2) + model_variance(i, engine, belief, model);
    let std = variance.sqrt();
    if engine.map.at_end(i, unknowns[i]) { std.max(engine.start_std[i]) } else { std }
}

/// Variance that the model's simplifications add, as far as the data and not the start values made the
/// estimate.
fn model_variance(i: usize, engine: &Engine, belief: &FactoredGaussian<STATES>, model: &Vector3<f64>) -> f64 {
    let left = std_of(&belief.factor, 3 + i) / engine.start().factor[(3 + i, 3 + i)];
    (1.0 - left * left).max(0.0) * model[i] * model[i]
}

/// Front axle's share of the load with its standard deviation. A standing machine carries itself
/// and the slope only: slip says nothing there.
fn load_ratio(
    engine: &Engine,
    belief: &FactoredGaussian<STATES>,
    machine: &Machine,
    motion: &Motion,
    unknowns: &Unknowns,
    drive: &Drive,
    standing: bool,
) -> (f64, f64) {
    let total = machine.weight(drive).max(1e-3 * machine.loader.mass * GRAVITY);
    let mut gradient = SVector::<f64, STATES>::zeros();
    let (point, _, derivatives) = machine.linearise(motion, unknowns, drive);
    let mut front = point.load[0];
    if standing || point.lift {
        let (still, by_centre_of_gravity) = machine.standing_front_load(unknowns, drive);
        gradient.fixed_rows_mut::<2>(4).copy_from_slice(&by_centre_of_gravity);
        front = if standing { still } else { front };
    } else {
        gradient.fixed_rows_mut::<6>(0).copy_from_slice(&derivatives);
        gradient[6] = derivatives[1] * motion[1];
        gradient[7] = derivatives[2] * motion[2];
    }
    let (slope, by_ratio) = (engine.map.slope(unknowns), gradient[5]);
    for i in 0..3 {
        gradient[3 + i] *= slope[i];
    }
    let model = by_ratio * by_ratio * model_variance(2, engine, belief, &engine.model_std(unknowns));
    let std = ((belief.factor.transpose() * gradient).norm_squared() + model).sqrt() / total;
    ((front / total).clamp(0.0, 1.0), std)
}
