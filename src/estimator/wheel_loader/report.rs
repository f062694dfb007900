//! The outputs: what the belief says about the machine now and a little later.

use super::belief::STATES;
use super::speed_evidence::Doubt;
use super::{Inputs, LoaderMachine, Outputs, State, drive};
use crate::Status;
use crate::model::wheel_loader::{Drive, Driven, GRAVITY, Motion, Unknowns, WheelLoader as Model};
use crate::variable::{Estimate, root_sum_square};
use nalgebra::SVector;

impl LoaderMachine {
    /// Conditions that follow from the state alone.
    pub(super) fn conditions(&self, state: &State) -> Status {
        let (map, belief) = (&self.filter.map, &state.belief);
        let unknowns = map.unknowns_of(&belief.mean);
        let height_std = self.uncertainty.std(1, map, belief, &unknowns, &self.doubt(state, unknowns[0]));
        let mut status = Status::OK;
        status.raise_if(!self.uncertainty.height_is_observable(height_std), Status::UNOBSERVABLE);
        status.raise_if(map.at_bound(&unknowns), Status::AT_BOUND);
        status.raise_if(state.supervision.holds(), Status::HOLD);
        status.raise_if(self.contradicted(state), Status::SLIP | Status::CONTRADICTED);
        if !state.supervision.holds() {
            let machine = map.corrected(&belief.mean);
            let lifts = Driven::new(&machine, &state.drive).lifts(&state.motion(), &unknowns);
            status.raise_if(lifts, Status::LIFT_OFF);
        }
        status
    }

    /// What a speed that comes late may have done to the estimates; what was given up knows nothing of it.
    fn doubt(&self, state: &State, stiffness: f64) -> Doubt {
        if self.contradicted(state) {
            return Doubt::default();
        }
        state.speed_evidence.doubt(stiffness, self.uncertainty.learnt(0, state.belief.std(3)))
    }

    /// Fills the outputs, the motion carried `horizon` seconds forward with `inputs` held.
    pub(super) fn report(&self, state: &State, inputs: &Inputs, horizon: f64, out: &mut Outputs) {
        let (map, belief, drive) = (&self.filter.map, &state.belief, drive(inputs));
        let held = state.supervision.holds();
        let unknowns = map.unknowns_of(&belief.mean);
        let (machine, mut motion) = (map.corrected(&belief.mean), state.motion());
        if !held && horizon > 0.0 {
            let substeps = (horizon / 0.005).ceil().clamp(1.0, 1000.0) as u32;
            motion = machine.advance(&motion, &unknowns, &drive, horizon, substeps);
        }
        let doubt = self.doubt(state, unknowns[0]);
        let unknown = |i: usize| Estimate::new(unknowns[i], self.uncertainty.std(i, map, belief, &unknowns, &doubt));
        (out.slip_stiffness, out.cg_height, out.cg_ratio) = (unknown(0), unknown(1), unknown(2));
        let wheelbase = machine.loader.wheelbase;
        out.cg_to_rear_axle = Estimate::new(out.cg_ratio.value * wheelbase, out.cg_ratio.std * wheelbase);
        let (given, radius) = (map.machine.loader.wheel_radius(), machine.loader.wheel_radius());
        let softness = self.uncertainty.radius_std(map, &unknowns);
        // the radii are those of the measured speed
        let scale = if self.filter.radii { self.speed_scale_std } else { 0.0 };
        let radius_std = |i: usize| {
            root_sum_square([given[i] * root_sum_square([belief.std(6 + i), doubt.radius, scale]), softness])
        };
        let radius = |i: usize| Estimate::new(radius[i], radius_std(i));
        (out.wheel_radius_front, out.wheel_radius_rear) = (radius(0), radius(1));
        out.speed_estimate = Estimate::new(motion[0], belief.std(0));
        out.speed_estimate.widen(root_sum_square([self.speed_scale_std, doubt.radius]) * motion[0]);
        let standing = !state.motion_known || (held && motion[0].abs() < self.hold.resume_speed);
        out.load_ratio = self.load_ratio(state, (&machine, &motion, &unknowns, &drive), &doubt, standing);
        out.hold = held;
        out.cg_height_observable = self.uncertainty.height_is_observable(out.cg_height.std);
        out.slip_inconsistent = self.contradicted(state);
        out.bend = state.paths.differs();
    }

    /// Front axle's share of the load. A standing machine carries itself and the slope only: slip says nothing there.
    fn load_ratio(
        &self,
        state: &State,
        (machine, motion, unknowns, drive): (&Model, &Motion, &Unknowns, &Drive),
        doubt: &Doubt,
        standing: bool,
    ) -> Estimate {
        let map = &self.filter.map;
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
        let (derivative, by_ratio) = (map.derivative(unknowns), gradient[5]);
        for i in 0..3 {
            gradient[3 + i] *= derivative[i];
        }
        let model = by_ratio * by_ratio * self.uncertainty.model_variance(2, map, state.belief.std(5), unknowns);
        let specific_force = if standing { GRAVITY * drive.slope.sin() } else { point.specific_force };
        let by_delay = self.uncertainty.share_by_delay(map, &state.belief, unknowns, doubt, specific_force);
        let std = (state.belief.variance_along(&gradient) + model).sqrt() / total;
        Estimate::new((front / total).clamp(0.0, 1.0), root_sum_square([std, by_delay]))
    }
}
