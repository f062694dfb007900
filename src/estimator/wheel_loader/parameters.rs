//! The declared parameters of the wheel loader's estimator.

use crate::ParameterError;
use crate::filter::innovation::Gate;
use crate::filter::srukf::UpdateForm;
use crate::model::wheel_loader::{Loader, Rolling, Tire, WheelLoader};

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
    /// What is known before the first sample.
    pub struct Initial {
        /// Slip stiffness: longitudinal force over axle load and slip.
        slip_stiffness: f64 = 19.0, "1", [2.01, 79.9], essential;
        /// Standard deviation of the slip stiffness.
        slip_stiffness_std: f64 = 10.0, "1", [1e-6, 40.0];
        /// Height of the centre of gravity above ground.
        cg_height: f64 = 0.95, "m", [0.301, 2.499], essential;
        /// Standard deviation of the height of the centre of gravity.
        cg_height_std: f64 = 0.16, "m", [1e-6, 2.0];
        /// Distance of the centre of gravity to the rear axle over the wheelbase: the front axle's share of the static load.
        cg_ratio: f64 = 0.45, "1", [0.101, 0.899], essential;
        /// Standard deviation of the centre of gravity's ratio.
        cg_ratio_std: f64 = 0.1, "1", [1e-6, 0.5];
        /// Relative standard deviation of each rolling radius as given, used if the radii are corrected online. Raise it to 0.003 where they were not calibrated.
        wheel_radius_std: f64 = 4e-4, "1", [1e-7, 0.05];
        /// Standard deviation of the speed, which the first sample gives.
        speed_std: f64 = 0.05, "m/s", [1e-6, 10.0];
        /// Standard deviation of the wheel speeds, which the first sample gives.
        wheel_speed_std: f64 = 0.1, "rad/s", [1e-6, 100.0];
    }
}

variables! {
    /// Process noise: power spectral densities of the random walks that are added to the model.
    pub struct ProcessPsd {
        /// Density of the unmodelled acceleration.
        speed: f64 = 0.01, "m2/s3", [0.0, 1e4], process_noise;
        /// Density of the unmodelled acceleration of the wheels.
        wheel_speed: f64 = 0.04, "rad2/s3", [0.0, 1e6], process_noise;
        /// Density of the drift of the slip stiffness in logit units; with direct coordinates scaled by the logit's derivative at the initial value.
        slip_stiffness: f64 = 2.25e-4, "1/s", [0.0, 100.0], process_noise;
        /// Density of the drift of the centre of gravity's height, in logit units.
        cg_height: f64 = 9e-6, "1/s", [0.0, 100.0], process_noise;
        /// Density of the drift of the centre of gravity's ratio, in logit units.
        cg_ratio: f64 = 4.9e-5, "1/s", [0.0, 100.0], process_noise;
        /// Density of the relative drift of the rolling radii.
        wheel_radius: f64 = 1e-10, "1/s", [0.0, 1e-2], process_noise;
    }
}

variables! {
    /// Measurement noise: standard deviations per sample. What bouncing tyres add is found online.
    pub struct MeasurementStd {
        /// Standard deviation of the speed sensor.
        speed: f64 = 0.02, "m/s", [1e-6, 10.0], measurement_noise;
        /// Standard deviation of the wheel speeds.
        wheel_speed: f64 = 0.035, "rad/s", [1e-6, 100.0], measurement_noise;
        /// Standard deviation of the steering angle's error, which lasts as long as a bend.
        steering_angle: f64 = 0.01, "rad", [0.0, 1.0];
        /// Standard deviation of the time by which the speed comes later than the wheel speeds, if it does not come within a sample period of them, which is taken to be as likely. Times the acceleration it looks like slip. 0: it does not.
        speed_delay: f64 = 0.05, "s", [0.0, 1.0];
        /// Relative standard deviation of the speed's scale, which looks like an error of both radii beyond initial.wheel_radius_std and counts in slip_stiffness_std, speed_estimate_std and wheel_radius_*_std. In one of a hundred machines it is four times as much: where that explains the slip far better, all deviations contain what it changes. 0: it is right, or the radii were calibrated against this speed; so it is with filter.radii = fixed.
        speed_scale: f64 = 0.005, "1", [0.0, 0.5];
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
        /// Measured slip beyond which a wheel spins; it grips again below 0.7 of that.
        slip: f64 = 0.12, "1", [1e-3, 10.0];
        /// Time after the start before the estimates are updated; transients of the tyres settle in it.
        settle_time: f64 = 0.5, "s", [0.0, 60.0];
        /// Time after a later hold, standstill or gap before the estimates are updated again; at most settle_time.
        resume_time: f64 = 0.17, "s", [0.0, 60.0];
        /// Successive samples without any measurement, or with an old value of an input that has none, after which the estimates are held. An input that never had one does not count.
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
    /// What the model's simplifications can make of the estimates however long the log is: standard deviations that are part of the reported ones as far as the data and not the initial values made the estimate.
    pub struct ModelError {
        /// Relative standard deviation of the slip stiffness, for tyres whose stiffness changes with load and traction.
        slip_stiffness: f64 = 0.04, "1", [0.0, 1.0];
        /// Relative standard deviation of the centre of gravity's height.
        cg_height: f64 = 0.06, "1", [0.0, 1.0];
        /// Standard deviation of the loss of rolling radius per tyre deflection. The model has rigid wheels; load transfer then looks like a centre of gravity further forward, which no data tell apart.
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
        /// Weight of the fourth moment; at least alpha squared. It is the variance that the transform gives the square of a unit Gaussian, which is 2. Below 0.8, that of the flattest distribution with one peak, covariances come out too small.
        beta: f64 = 2.0, "1", [0.8, 100.0];
        /// Second spread of the sigma points.
        kappa: f64 = 0.0, "1", [-5.0, 100.0];
        /// Implicit steps of the model per sample; more are taken where one would be longer than 10 ms.
        substeps: i32 = 2, "1", [1, 100];
        /// Whether a step of the model may pass rolling where a tyre is saturated, as the study's do; only for comparisons.
        overshoot: bool = false, "1";
        /// Whether a sample's drive is the mean of the last two inputs (true) or the last one.
        interpolate_inputs: bool = true, "1";
        /// Hold, gates, limits of the standard deviations and the comparison of slip and torque; off only for comparisons.
        supervise: bool = true, "1";
        /// Innovations beyond so many standard deviations are rejected.
        gate: f64 = 6.0, "1", [1.0, 1e6], tunable;
        /// After so many rejections of a channel in a row the motion follows its samples until one agrees.
        gate_patience: i32 = 20, "1", [0, 1_000_000];
        /// Process noise.
        process_psd: ProcessPsd;
        /// Measurement noise.
        measurement_std: MeasurementStd;
        /// Adaptation of the measurement noise.
        adaptation: Adaptation;
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
        sample_period: f64 = 0.01, "s", [1e-4, 0.5], essential;
        /// The machine.
        loader: Loader;
        /// Rolling resistance.
        rolling: Rolling;
        /// The tyres.
        tire: Tire;
        /// What is known before the first sample.
        initial: Initial;
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

impl Parameters {
    /// The machine for the model.
    pub fn machine(&self) -> WheelLoader {
        WheelLoader { loader: self.loader, rolling: self.rolling, tire: self.tire }
    }

    /// The gate; without supervision it rejects nothing.
    pub(super) fn gate(&self) -> Gate {
        let Filter { gate, gate_patience, supervise, .. } = self.filter;
        if supervise { Gate { deviations: gate, patience: gate_patience.max(0) as u32 } } else { Gate::OPEN }
    }

    /// Form of the measurement update.
    pub(super) fn form(&self) -> UpdateForm {
        match self.filter.form {
            Form::Array => UpdateForm::Array,
            Form::Andrews => UpdateForm::Andrews,
        }
    }

    /// Refuses values within their ranges that do not go together.
    pub(super) fn check(&self) -> Result<(), ParameterError> {
        let refuse =
            |name: &str, value, unit, reason| Err(ParameterError { name: name.to_owned(), value, unit, reason });
        let Filter { alpha, beta, .. } = self.filter;
        if beta < alpha * alpha {
            let reason = format!("is below filter.alpha^2 = {}: the covariance would need a downdate", alpha * alpha);
            return refuse("filter.beta", beta, "1", reason);
        }
        let Hold { stop_speed, resume_speed, .. } = self.hold;
        let Loader { wheelbase, joint_to_front_axle, .. } = self.loader;
        if joint_to_front_axle > wheelbase {
            let reason = format!("lies behind the rear axle: it must not exceed loader.wheelbase = {wheelbase}");
            return refuse("loader.joint_to_front_axle", joint_to_front_axle, "m", reason);
        }
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
