//! The declared parameters, inputs and outputs of the wheel loader's estimator.

use crate::model::wheel_loader::{Loader, Rolling, Tire, WheelLoader};
use crate::{ParameterError, Status, Variables};

choice! {
    /// Kind of the filter's time update.
    pub enum Kind { SquareRootUnscented = "srukf", Extended = "ekf" }
}

choice! {
    /// Form of the measurement update; all forms agree in exact arithmetic.
    pub enum Form { Array = "array", Andrews = "andrews" }
}

choice! {
    /// Coordinates in which the unknowns are estimated.
    pub enum Coordinates { Logit = "logit", Direct = "direct" }
}

choice! {
    /// Whether the rolling radii are taken as they are or corrected online.
    pub enum Radii { Estimated = "estimated", Fixed = "fixed" }
}

variables! {
    /// What is assumed of the unknowns before the first sample.
    pub struct Start {
        /// Slip stiffness: longitudinal force over axle load and slip.
        slip_stiffness: f64 = 19.0, "1", [2.01, 79.9];
        /// Standard deviation of the slip stiffness.
        slip_stiffness_std: f64 = 10.0, "1", [1e-6, 40.0];
        /// Height of the centre of gravity above ground.
        cg_height: f64 = 0.95, "m", [0.301, 2.499];
        /// Standard deviation of the height of the centre of gravity.
        cg_height_std: f64 = 0.16, "m", [1e-6, 2.0];
        /// Distance of the centre of gravity to the rear axle over the wheelbase: the front axle's share of the static load.
        cg_ratio: f64 = 0.45, "1", [0.101, 0.899];
        /// Standard deviation of the centre of gravity's ratio.
        cg_ratio_std: f64 = 0.1, "1", [1e-6, 0.5];
        /// Relative standard deviation of each rolling radius as given, used if the radii are corrected online. Raise it to 0.003 where they were not calibrated.
        wheel_radius_std: f64 = 4e-4, "1", [1e-7, 0.05];
    }
}

variables! {
    /// One standard deviation per state of the motion and per unknown.
    pub struct ProcessStd {
        /// Process noise of the speed per 10 ms.
        speed: f64 = 0.01, "m/s", [0.0, 10.0];
        /// Process noise of the wheel speeds per 10 ms.
        wheel_speed: f64 = 0.02, "rad/s", [0.0, 100.0];
        /// Random walk of the slip stiffness per 10 ms, in logit units; with direct coordinates scaled by the logit's slope at the start value.
        slip_stiffness: f64 = 1.5e-3, "1", [0.0, 1.0];
        /// Random walk of the centre of gravity's height per 10 ms, in logit units.
        cg_height: f64 = 3e-4, "1", [0.0, 1.0];
        /// Random walk of the centre of gravity's ratio per 10 ms, in logit units.
        cg_ratio: f64 = 7e-4, "1", [0.0, 1.0];
        /// Relative random walk of the rolling radii per 10 ms.
        wheel_radius: f64 = 1e-6, "1", [0.0, 1e-2];
    }
}

variables! {
    /// Noise of the measurements.
    pub struct MeasurementStd {
        /// Noise of the speed sensor per sample; what bouncing tyres add is found online.
        speed: f64 = 0.02, "m/s", [1e-6, 10.0];
        /// Noise of the wheel speeds per sample; what bouncing tyres add is found online.
        wheel_speed: f64 = 0.035, "rad/s", [1e-6, 100.0];
    }
}

variables! {
    /// Standard deviations of the motion at the first sample.
    pub struct MotionStd {
        /// Standard deviation of the speed.
        speed: f64 = 0.05, "m/s", [1e-6, 10.0];
        /// Standard deviation of the wheel speeds.
        wheel_speed: f64 = 0.1, "rad/s", [1e-6, 100.0];
    }
}

variables! {
    /// Lower limits of the unknowns' standard deviations, in logit units.
    pub struct MinimumStd {
        /// Of the slip stiffness.
        slip_stiffness: f64 = 0.02, "1", [0.0, 10.0];
        /// Of the centre of gravity's height. Not smaller than what tyres that differ from the model can make of it.
        cg_height: f64 = 0.1, "1", [0.0, 10.0];
        /// Of the centre of gravity's ratio.
        cg_ratio: f64 = 0.01, "1", [0.0, 10.0];
    }
}

variables! {
    /// Upper limits of the standard deviations.
    pub struct MaximumStd {
        /// Of the speed.
        speed: f64 = 1.0, "m/s", [1e-3, 100.0];
        /// Of the wheel speeds.
        wheel_speed: f64 = 5.0, "rad/s", [1e-3, 1e3];
        /// Of the slip stiffness, in logit units.
        slip_stiffness: f64 = 1.5, "1", [1e-3, 10.0];
        /// Of the centre of gravity's height, in logit units.
        cg_height: f64 = 0.5, "1", [1e-3, 10.0];
        /// Of the centre of gravity's ratio, in logit units.
        cg_ratio: f64 = 1.0, "1", [1e-3, 10.0];
    }
}

variables! {
    /// When samples teach nothing about the unknowns.
    pub struct Hold {
        /// Active estimation stops below this speed.
        stop_speed: f64 = 0.4, "m/s", [0.0, 10.0];
        /// Held estimation goes on above this speed.
        resume_speed: f64 = 0.6, "m/s", [0.0, 10.0];
        /// Measured slip beyond which a wheel spins.
        slip: f64 = 0.12, "1", [1e-3, 10.0];
        /// Time after the start or a hold before the estimates are updated; transients of the tyres settle in it.
        settle_time: f64 = 0.5, "s", [0.0, 60.0];
        /// Successive samples without any measurement, or with an input that had to be replaced, after which the estimates are held.
        samples: i32 = 50, "1", [0, 1_000_000];
    }
}

variables! {
    /// How the measurement noise follows the road.
    pub struct Adaptation {
        /// Whether the measurement noise follows the slip innovations. Off, the measurement noise has to cover the road.
        enabled: bool = true, "1";
        /// Smoothing of the slip innovations: disturbances correlated over this time count with their full weight.
        smoothing: f64 = 0.02, "s", [0.001, 10.0];
        /// Memory of the noise level.
        memory: f64 = 1.0, "s", [0.01, 100.0];
        /// Largest ratio by which the noise's standard deviation is raised for long.
        limit: f64 = 10.0, "1", [1.0, 1e3];
        /// Slip innovations beyond so many standard deviations count less, in proportion to their size.
        huber: f64 = 1.0, "1", [0.1, 1e6];
    }
}

variables! {
    /// What the model's simplifications can make of the estimates however long the log is: standard deviations that are part of the reported ones as far as the data and not the start values made the estimate.
    pub struct ModelError {
        /// Relative standard deviation of the slip stiffness, for tyres whose stiffness changes with load and traction.
        slip_stiffness: f64 = 0.04, "1", [0.0, 1.0];
        /// Relative standard deviation of the centre of gravity's height.
        cg_height: f64 = 0.06, "1", [0.0, 1.0];
        /// Standard deviation of the loss of rolling radius per tyre deflection. The model has rigid wheels; load transfer then looks like a centre of gravity further ahead, which no data tell apart.
        radius_softness: f64 = 0.05, "1", [0.0, 1.0];
        /// Vertical stiffness of an axle's tyres, by which their deflection follows the load.
        tire_stiffness: f64 = 7e5, "N/m", [1e3, 1e9];
    }
}

variables! {
    /// The filter.
    pub struct Filter {
        /// Time update by sigma points or by linearisation.
        kind: Kind = Kind::SquareRootUnscented, "1";
        /// Measurement update by one orthogonal transformation or by Andrews' formula.
        form: Form = Form::Array, "1";
        /// Unknowns as logits, which cannot leave their range, or as they are and clipped.
        parameters: Coordinates = Coordinates::Logit, "1";
        /// Whether the rolling radii are corrected online: coasting and changing torque reveal them.
        radii: Radii = Radii::Estimated, "1";
        /// Spread of the sigma points. Wider ones reach slips that no drive has, and read a slip stiffness from them at low speed.
        alpha: f64 = 0.3, "1", [1e-4, 10.0];
        /// Weight of the fourth moment; at least alpha squared.
        beta: f64 = 2.0, "1", [0.0, 100.0];
        /// Second spread of the sigma points.
        kappa: f64 = 0.0, "1", [-5.0, 100.0];
        /// Implicit steps of the model per sample; more are taken where one would be longer than 10 ms.
        substeps: i32 = 2, "1", [1, 100];
        /// Whether a sample's drive is the mean of the last two inputs (true) or the last one.
        interpolate_inputs: bool = true, "1";
        /// Hold, gates, limits of the standard deviations and the check of slip against torque; off only for comparisons.
        supervise: bool = true, "1";
        /// Innovations beyond so many standard deviations are rejected.
        gate: f64 = 6.0, "1", [1.0, 1e6], tunable;
        /// Largest number of successive rejections per channel; after it the motion follows the measurement again.
        gate_samples: i32 = 20, "1", [0, 1_000_000];
        /// Process noise.
        process_std: ProcessStd;
        /// Measurement noise.
        measurement_std: MeasurementStd;
        /// Adaptation of the measurement noise.
        adaptation: Adaptation;
        /// Motion at the first sample.
        start_std: MotionStd;
        /// Lower limits.
        minimum_std: MinimumStd;
        /// Upper limits.
        maximum_std: MaximumStd;
    }
}

variables! {
    /// All parameters.
    pub struct Parameters {
        /// Time between two samples.
        sample_period: f64 = 0.01, "s", [1e-4, 0.5];
        /// The machine.
        loader: Loader;
        /// Rolling resistance.
        rolling: Rolling;
        /// The tyres.
        tire: Tire;
        /// Prior knowledge of the unknowns.
        start: Start;
        /// When the estimates are held.
        hold: Hold;
        /// The filter.
        filter: Filter;
        /// What the model leaves out.
        model_error: ModelError;
        /// Standard deviation of the centre of gravity's ratio up to which the estimates count as healthy.
        healthy_std: f64 = 0.05, "1", [1e-6, 1.0], tunable;
    }
}

variables! {
    /// What is measured.
    pub struct Inputs {
        /// Net drive torque of the front axle at the wheels, positive forward. A missing sample keeps the last value for a while, then the estimates are held.
        torque_front: f64 = 0.0, "N.m", measured;
        /// Net drive torque of the rear axle at the wheels, positive forward. A missing sample keeps the last value for a while.
        torque_rear: f64 = 0.0, "N.m", measured;
        /// Magnitude of the front axle's brake torque. A missing sample keeps the last value for a while.
        brake_front: f64 = 0.0, "N.m", measured;
        /// Magnitude of the rear axle's brake torque. A missing sample keeps the last value for a while.
        brake_rear: f64 = 0.0, "N.m", measured;
        /// Slope, positive uphill. A missing sample keeps the last value for a while.
        slope: f64 = 0.0, "rad", measured;
        /// Spading force at the bucket's tip, positive when it pushes the machine backwards. A missing sample keeps the last value for a while.
        spading_force_x: f64 = 0.0, "N", measured;
        /// Spading force at the bucket's tip, positive when it pulls the bucket down. A missing sample keeps the last value for a while.
        spading_force_z: f64 = 0.0, "N", measured;
        /// Speed over ground; NaN is a missing sample.
        speed: f64 = 0.0, "m/s", measured;
        /// Wheel speed of the front axle; NaN is a missing sample.
        wheel_speed_front: f64 = 0.0, "rad/s", measured;
        /// Wheel speed of the rear axle; NaN is a missing sample.
        wheel_speed_rear: f64 = 0.0, "rad/s", measured;
    }
}

variables! {
    /// What is estimated.
    pub struct Outputs {
        /// Distance of the centre of gravity to the rear axle over the wheelbase. Geometric: acceleration does not move it.
        cg_ratio: f64 = 0.45, "1";
        /// Standard deviation of the centre of gravity's ratio.
        cg_ratio_std: f64 = 0.1, "1";
        /// Height of the centre of gravity above ground. Only changing acceleration reveals it; read it with its standard deviation.
        cg_height: f64 = 0.95, "m";
        /// Standard deviation of the height of the centre of gravity.
        cg_height_std: f64 = 0.16, "m";
        /// Distance of the centre of gravity to the rear axle.
        cg_to_rear_axle: f64 = 0.99, "m";
        /// Standard deviation of the distance of the centre of gravity to the rear axle.
        cg_to_rear_axle_std: f64 = 0.22, "m";
        /// Slip stiffness of the tyres: longitudinal force over axle load and slip.
        slip_stiffness: f64 = 19.0, "1";
        /// Standard deviation of the slip stiffness.
        slip_stiffness_std: f64 = 10.0, "1";
        /// Front axle's share of the present load, which moves with acceleration, slope and spading.
        load_ratio: f64 = 0.45, "1";
        /// Standard deviation of the front axle's share of the load.
        load_ratio_std: f64 = 0.1, "1";
        /// Rolling radius of the front wheels, as given or as corrected online.
        wheel_radius_front: f64 = 0.55, "m";
        /// Standard deviation of the front rolling radius; 0 if the radii are taken as given.
        wheel_radius_front_std: f64 = 0.0, "m";
        /// Rolling radius of the rear wheels, as given or as corrected online.
        wheel_radius_rear: f64 = 0.55, "m";
        /// Standard deviation of the rear rolling radius; 0 if the radii are taken as given.
        wheel_radius_rear_std: f64 = 0.0, "m";
        /// Speed over ground.
        speed_estimate: f64 = 0.0, "m/s";
        /// Standard deviation of the speed.
        speed_estimate_std: f64 = 0.05, "m/s";
        /// The unknowns are held: standstill, a spinning wheel, no data, or slip that contradicts the torque.
        hold: bool = true, "1";
        /// The data have at least halved the standard deviation that the height of the centre of gravity started with.
        cg_height_observable: bool = false, "1";
        /// Torque acts but the measured slip is smaller than any tyre allows, or has the wrong sign: a sensor or a radius is wrong.
        slip_inconsistent: bool = false, "1";
        /// Normalised innovation squared per channel of the last sample; near 1 if the noise settings fit.
        nis: f64 = 0.0, "1";
        /// Logarithm of the likelihood of the last measurement, 0 without one.
        log_likelihood: f64 = 0.0, "1";
        /// Conditions of the last sample as a bit field.
        status: Status = Status::OK, "1";
        /// The centre of gravity's ratio is known well enough and the inputs are sound.
        healthy: bool = false, "1";
    }
}

impl Parameters {
    /// The machine for the model.
    pub fn machine(&self) -> WheelLoader {
        WheelLoader { loader: self.loader, rolling: self.rolling, tire: self.tire }
    }

    /// Every value within its range, and those that go together.
    pub(super) fn check(&self) -> Result<(), ParameterError> {
        self.validate()?;
        let refuse =
            |name: &str, value, unit, reason| Err(ParameterError { name: name.to_owned(), value, unit, reason });
        let Filter { alpha, beta, .. } = self.filter;
        if beta < alpha * alpha {
            let reason = format!("is below filter.alpha^2 = {}: the covariance would need a downdate", alpha * alpha);
            return refuse("filter.beta", beta, "1", reason);
        }
        let Hold { stop_speed, resume_speed, .. } = self.hold;
        if resume_speed < stop_speed {
            return refuse(
                "hold.resume_speed",
                resume_speed,
                "m/s",
                format!("is below hold.stop_speed = {stop_speed}"),
            );
        }
        Ok(())
    }
}
