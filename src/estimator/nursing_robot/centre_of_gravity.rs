//! Where the centres of gravity of the person and of the whole lie, and how well that is known.

use super::{NursingMachine, Outputs};
use crate::variable::{Estimate, root_sum_square};

impl NursingMachine {
    /// From the mass and the pitch in `out`.
    pub(super) fn report_centre_of_gravity(&self, out: &mut Outputs) {
        let (robot, human) = (&self.parameters.robot, &self.parameters.human);
        let (mass, pitch) = (out.load_mass, out.body_pitch);
        let (person, by_pitch) = human.cog(robot.seat_height, pitch.value);
        let common = robot.common_cog(mass.value, person);
        let (share, per_mass) = robot.load_share(mass.value);
        let x_std = (by_pitch.x * pitch.std).abs();
        // The height is stationary upright: the second-order term is kept there.
        let z_std = root_sum_square([by_pitch.z * pitch.std, by_pitch.x * pitch.std * pitch.std * 0.5f64.sqrt()]);
        let common_x_std = root_sum_square([share * x_std, person.x * per_mass * mass.std]);
        let common_z_std = root_sum_square([share * z_std, (person.z - robot.cog_height) * per_mass * mass.std]);
        out.load_cog_x = Estimate::new(person.x, x_std);
        out.load_cog_z = Estimate::new(person.z, z_std);
        out.cog_x = Estimate::new(common.x, common_x_std);
        out.cog_z = Estimate::new(common.z, common_z_std);
    }
}
