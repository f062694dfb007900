//! The slip that the torques take once the wheels follow them, which they do within milliseconds: what the model says of
//! measured slip without a filter.

use super::{Drive, GRAVITY, Unknowns, WheelLoader};

/// What the drive makes of the machine, wheels and body moving as one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadySlip {
    /// `v'`, m/s2.
    pub acceleration: f64,
    /// Slip times its stiffness, `K sigma_i`.
    pub demand: [f64; 2],
    /// Derivatives of `ln sigma_i` to `[h, lambda]`.
    pub by_height_and_ratio: [[f64; 2]; 2],
}

impl WheelLoader {
    /// At speed `v`, whose sign alone counts:
    ///
    /// ```text
    /// v' = (sum (T_i - B_i s)/r_i - f s W - F_x - m g sin alpha) / (m + sum I_i/r_i^2)
    /// mu_i = ((T_i - B_i s)/r_i - I_i v'/r_i^2) / F_zi
    /// ```
    pub fn steady_slip(&self, v: f64, p: &Unknowns, u: &Drive) -> SteadySlip {
        let (loader, [_, h, _]) = (&self.loader, (*p).into());
        let (radius, inertia, m) = (loader.wheel_radius(), loader.axle_inertia(), loader.mass);
        let (weight, sense, sin) = (self.weight(u), v.signum(), u.slope.sin());
        let drive = [0, 1].map(|i| (u.torque[i] - u.brake[i] * sense) / radius[i]);
        let spinning = [0, 1].map(|i| inertia[i] / (radius[i] * radius[i]));
        let resistance = self.rolling.coefficient * sense * weight + u.force_x + m * GRAVITY * sin;
        let acceleration = (drive[0] + drive[1] - resistance) / (m + spinning[0] + spinning[1]);
        // The standing load is that with a_s = g sin alpha.
        let (standing, _) = self.standing_front_load(p, u);
        let front = standing - m * h / loader.wheelbase * acceleration;
        let specific_force = acceleration + GRAVITY * sin;
        let least = 0.02 * m * GRAVITY;
        let load = [front.max(least), (weight - front).max(least)];
        let demand = [0, 1].map(|i| self.tire.demanding((drive[i] - spinning[i] * acceleration) / load[i]));
        let front_by = [-m * specific_force / loader.wheelbase, m * GRAVITY * u.slope.cos()];
        SteadySlip {
            acceleration,
            demand,
            by_height_and_ratio: [front_by.map(|by| -by / load[0]), front_by.map(|by| by / load[1])],
        }
    }
}
