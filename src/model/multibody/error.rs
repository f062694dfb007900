//! What can be wrong with a model of rigid bodies, its sensors or its variances.

/// A model that was refused; each message names the link, joint or sensor.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// A link has two parents, or a joint closes a loop.
    #[error("the joints form a loop at link '{0}'; only trees are supported")]
    KinematicLoop(String),
    /// There is more than one root.
    #[error("the model falls apart: links '{0}' and '{1}' both have no parent")]
    Disconnected(String, String),
    /// No link of this name.
    #[error("there is no link '{0}'")]
    UnknownLink(String),
    /// No joint of this name.
    #[error("there is no joint '{0}'")]
    UnknownJoint(String),
    /// A fixed joint has neither torque nor acceleration.
    #[error("joint '{0}' is fixed and has no variables of its own")]
    FixedJoint(String),
    /// Two links or two joints share a name.
    #[error("there are two {1}s named '{0}'")]
    DuplicateName(String, &'static str),
    /// A model without links.
    #[error("the model has no links")]
    Empty,
    /// A negative mass.
    #[error("link '{0}' has the negative mass {1} kg")]
    NegativeMass(String, f64),
    /// All masses are zero.
    #[error("the total mass is zero")]
    ZeroTotalMass,
    /// A rotational inertia with a negative principal moment.
    #[error("the rotational inertia of link '{0}' is not positive semidefinite (a principal moment is {1} kg.m2)")]
    InertiaNotPsd(String, f64),
    /// A number of the model is NaN or infinite.
    #[error("a number of '{0}' is not finite")]
    NotFinite(String),
    /// A joint axis of length zero.
    #[error("joint '{0}' has an axis of length zero")]
    BadAxis(String),
    /// A joint type that has no place in a tree of revolute and prismatic joints.
    #[error("joint '{0}' is of type '{1}'; supported are revolute, continuous, prismatic and fixed")]
    UnsupportedJoint(String, String),
    /// A sensor on a base that does not move measures nothing, except the base's reaction.
    #[error("sensor '{0}' sits on the fixed base '{1}', where only net_ext_wrench measures anything")]
    SensorOnFixedBase(String, String),
    /// A sensor of a moving base in a model whose base is fixed.
    #[error("sensor '{0}' measures the base, which is fixed; use variant \"moving\"")]
    BaseIsFixed(String),
    /// A variance that is not positive. A hard constraint is written as 1e-12.
    #[error("{0} has the variance {1}; it must be positive and finite (the smallest useful one is 1e-12)")]
    BadVariance(String, f64),
    /// A full covariance that is not symmetric positive definite.
    #[error("the covariance of sensor '{0}' is not symmetric positive definite")]
    CovarianceNotSpd(String),
    /// A sensor with the wrong number of variances.
    #[error("sensor '{0}' has {1} variances for {2} rows")]
    VarianceCount(String, usize, usize),
}

/// Something unusual in a model that is accepted nevertheless.
#[derive(Clone, Debug, PartialEq)]
pub enum ModelWarning {
    /// The principal moments of inertia of this link violate the triangle inequality: no real body has them.
    TriangleInequality(String),
}

impl std::fmt::Display for ModelWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TriangleInequality(link) => write!(
                f,
                "the principal moments of inertia of link '{link}' violate the triangle inequality: no real body has them"
            ),
        }
    }
}
