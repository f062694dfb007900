//! How the body moves over one step, in each of the filter's models.

use super::{Form, SwayEstimator, SwayState};
use crate::filter::discretise::runge_kutta;
use crate::model::four::Four;
use crate::model::nursing_robot::{Human, Lean, Planar};
use multiversion::multiversion;
use nalgebra::{SMatrix, SVector};

/// What is constant during one step.
pub(super) struct Step<'a> {
    form: Form,
    pub(super) planar: Planar,
    pub(super) force: f64,
    /// The pitch before the step, near which all points of the step lie.
    lean: Lean,
    omega: f64,
    /// The wheels are held.
    pub(super) held: bool,
    torque_time: f64,
    mass: f64,
    human: &'a Human,
    pub(super) dt: f64,
}

impl SwayEstimator {
    /// The equations of one step over `dt` under a drive force, with the load mass of the state; the hip's
    /// spring and damper stay as they are.
    pub(super) fn step_of(&self, state: &SwayState, force: f64, dt: f64) -> Step<'_> {
        Step {
            form: self.form,
            planar: Planar::new(&self.robot, &self.rolling, &self.human, state.mass),
            force,
            lean: Lean::new(state.belief.pitch()),
            omega: state.yaw_rate,
            held: state.standstill.is_still(),
            torque_time: self.torque_time,
            mass: state.mass,
            human: &self.human,
            dt,
        }
    }
}

impl Step<'_> {
    /// The state one step later.
    pub(super) fn propagate<const N: usize>(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        match self.form {
            Form::PaperRaw | Form::Paper => {
                let push = self.force - self.planar.rolling_resistance(x[0]) - self.paper_force(x[1]);
                SVector::from_fn(|i, _| if i == 0 { x[0] + self.dt * push / self.planar.inertial_mass } else { x[i] })
            }
            Form::Sound | Form::SoundTorque => runge_kutta(x, self.dt, |x| self.derivative(x)),
        }
    }

    /// [`propagate`](Self::propagate) of several states, four at a time.
    pub(super) fn propagate_all<const N: usize, const P: usize>(
        &self,
        x: &[SVector<f64, N>; P],
    ) -> [SVector<f64, N>; P] {
        if matches!(self.form, Form::PaperRaw | Form::Paper) {
            return x.map(|x| self.propagate(&x));
        }
        let mut moved = *x;
        for (moved, x) in moved.chunks_mut(4).zip(x.chunks(4)) {
            // one state per row; those that are missing at the end are the first one again
            let rows = SMatrix::<f64, 4, N>::from_fn(|lane, i| x[if lane < x.len() { lane } else { 0 }][i]);
            let rows = advance(self, &rows);
            for (lane, moved) in moved.iter_mut().enumerate() {
                *moved = SVector::from_fn(|i, _| rows[(lane, i)]);
            }
        }
        moved
    }

    fn derivative<const N: usize>(&self, x: &SVector<f64, N>) -> SVector<f64, N> {
        let (v_dot, phi_ddot) = self.acceleration(x, &self.lean.moved_to(x[1]));
        let active = if N > 3 { x[3] } else { 0.0 };
        SVector::from_fn(|i, _| [v_dot, x[2], phi_ddot, -active / self.torque_time][i])
    }

    /// `(v', phi'')`.
    fn acceleration<const N: usize>(&self, x: &SVector<f64, N>, lean: &Lean) -> (f64, f64) {
        let active = if N > 3 { x[3] } else { 0.0 };
        if self.held {
            return (0.0, self.planar.held_acceleration(lean, x[2], self.omega, active));
        }
        let force = self.force - self.planar.rolling_resistance(x[0]);
        self.planar.acceleration(force, lean, x[2], self.omega, active)
    }

    /// [`derivative`](Self::derivative) of four states, one per row.
    #[inline(always)]
    fn derivatives<const N: usize>(&self, x: &SMatrix<f64, 4, N>) -> SMatrix<f64, 4, N> {
        let [v, phi, phi_dot] = [0, 1, 2].map(|i| Four::new(x.data.0[i]));
        let active = if N > 3 { Four::new(x.data.0[3]) } else { Four::ZERO };
        let leans = self.lean.moved_to_each(phi);
        let (v_dot, phi_ddot) = if self.held {
            (Four::ZERO, self.planar.held_accelerations(&leans, phi_dot, self.omega, active))
        } else {
            let force = Four::splat(self.force) - self.planar.rolling_resistances(v);
            self.planar.accelerations(force, &leans, phi_dot, self.omega, active)
        };
        let fading = -active / Four::splat(self.torque_time);
        let mut rates = SMatrix::zeros();
        for (column, rate) in rates.data.0.iter_mut().zip([v_dot, phi_dot, phi_ddot, fading]) {
            *column = rate.to_array();
        }
        rates
    }

    /// Force of the swaying body, N.
    pub(super) fn sway_force<const N: usize>(&self, x: &SVector<f64, N>) -> f64 {
        if N < 3 {
            return self.paper_force(x[1]);
        }
        let lean = self.lean.moved_to(x[1]);
        let (_, phi_ddot) = self.acceleration(x, &lean);
        self.planar.sway_force(&lean, x[2], phi_ddot, self.omega)
    }

    /// The paper's disturbance force, N.
    fn paper_force(&self, phi: f64) -> f64 {
        match self.form {
            Form::PaperRaw => self.planar.printed_force(self.human, self.mass, phi),
            _ => self.planar.paper_force(phi),
        }
    }
}

/// Four states one step later, one per row.
#[multiversion(targets("x86_64+avx+avx2"))]
fn advance<const N: usize>(step: &Step, x: &SMatrix<f64, 4, N>) -> SMatrix<f64, 4, N> {
    runge_kutta(x, step.dt, |x| step.derivatives(x))
}
