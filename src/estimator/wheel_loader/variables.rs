//! What is measured and what is estimated.

use crate::estimator::Diagnostics;
use crate::variable::Estimate;

variables! {
    /// What is measured.
    pub struct Inputs {
        /// Net drive torque of the front axle at the wheels, positive forward. NaN = the last value holds, for a while.
        torque_front: f64 = f64::NAN, "N.m", [-1e8, 1e8], held;
        /// Net drive torque of the rear axle at the wheels, positive forward. NaN = the last value holds, for a while.
        torque_rear: f64 = f64::NAN, "N.m", [-1e8, 1e8], held;
        /// Brake torque of the front axle; its magnitude counts. NaN = the last value holds, for a while.
        brake_front: f64 = f64::NAN, "N.m", [-1e8, 1e8], held;
        /// Brake torque of the rear axle; its magnitude counts. NaN = the last value holds, for a while.
        brake_rear: f64 = f64::NAN, "N.m", [-1e8, 1e8], held;
        /// Slope, positive uphill. NaN = the last value holds, for a while.
        slope: f64 = f64::NAN, "rad", [-1.5, 1.5], held;
        /// Spading force at the bucket's tip, positive when it pushes the machine backwards. NaN = the last value holds, for a while.
        spading_force_x: f64 = f64::NAN, "N", [-1e8, 1e8], held;
        /// Spading force at the bucket's tip, positive when it pulls the bucket down. NaN = the last value holds, for a while.
        spading_force_z: f64 = f64::NAN, "N", [-1e8, 1e8], held;
        /// Speed over ground; in a bend that of the rear axle. NaN = no sample.
        speed: f64 = f64::NAN, "m/s", [-200.0, 200.0], measured;
        /// Wheel speed of the front axle. NaN = no sample.
        wheel_speed_front: f64 = f64::NAN, "rad/s", [-2e3, 2e3], measured;
        /// Wheel speed of the rear axle. NaN = no sample.
        wheel_speed_rear: f64 = f64::NAN, "rad/s", [-2e3, 2e3], measured;
        /// Steering angle: of the front wheels, or of the front half relative to the rear half; used unless loader.steering is none. NaN = the last value holds, for a while.
        steering_angle: f64 = f64::NAN, "rad", [-1.5, 1.5], held;
    }
}

variables! {
    /// What is estimated.
    pub struct Outputs {
        /// Distance of the centre of gravity to the rear axle over the wheelbase. Geometric: acceleration does not move it.
        cg_ratio: Estimate = Estimate::NONE, "1";
        /// Height of the centre of gravity above ground. Only changing acceleration reveals it; read it with its standard deviation.
        cg_height: Estimate = Estimate::NONE, "m";
        /// Distance of the centre of gravity to the rear axle.
        cg_to_rear_axle: Estimate = Estimate::NONE, "m";
        /// Slip stiffness of the tyres: longitudinal force over axle load and slip.
        slip_stiffness: Estimate = Estimate::NONE, "1";
        /// Front axle's share of the present load, which moves with acceleration, slope and spading; without what bumps do to it for less than half a second.
        load_ratio: Estimate = Estimate::NONE, "1";
        /// Rolling radius of the front wheels, as given (standard deviation 0) or as corrected online.
        wheel_radius_front: Estimate = Estimate::NONE, "m";
        /// Rolling radius of the rear wheels, as given (standard deviation 0) or as corrected online.
        wheel_radius_rear: Estimate = Estimate::NONE, "m";
        /// Speed over ground.
        speed_estimate: Estimate = Estimate::NONE, "m/s";
        /// The unknowns are held: standstill, a spinning wheel, a bend, no data, or slip that contradicts the torque.
        hold: bool = true, "1";
        /// The axles' paths differ in length and no slip explains it, as in a bend whose steering angle is not measured: the unknowns are held, and nothing is healthy.
        bend: bool = false, "1";
        /// The data have at least halved the standard deviation that the height of the centre of gravity started with.
        cg_height_observable: bool = false, "1";
        /// Slip and torque contradict each other: torque acts but the measured slip is smaller than any tyre allows or has the wrong sign, or a wheel has spun for seconds without the torque that this takes; or slip follows the acceleration instead of the torque, as it does if the speed comes late; or gravity does not follow the slope. A sensor, its unit, its delay or a radius is wrong.
        slip_inconsistent: bool = false, "1";
        /// What holds of the last sample. Contradicted: also slip_inconsistent. Unobservable: the height of the centre of gravity. Slip: a wheel spins or locks, or slip_inconsistent.
        @flat diagnostics: Diagnostics;
    }
}

impl AsMut<Diagnostics> for Outputs {
    fn as_mut(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }
}
