//! `sensors.toml`: base, variances and sensors of an estimation.

use super::EstimateError;
use nalgebra::Vector3;
use serde::Deserialize;
use std::path::Path;
use wheelstate::Variables;
use wheelstate::estimator::human_dynamics::whole_body::WholeBody;
use wheelstate::model::STANDARD_GRAVITY;
use wheelstate::model::multibody::equations::{Base, Kind};
use wheelstate::model::multibody::error::ModelError;
use wheelstate::model::multibody::prior::Variances;
use wheelstate::model::multibody::scatter::ScatterParameters;
use wheelstate::model::multibody::sensors::{Attachment, Noise, Quantity, Sensor};
use wheelstate::model::multibody::spatial::Pose;
use wheelstate::model::multibody::tree::{Description, Tree};

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    base: String,
    variant: Variant,
    #[serde(default)]
    compact: bool,
    gravity: Option<[f64; 3]>,
    #[serde(default)]
    variance: VarianceTable,
    #[serde(default)]
    scatter: ScatterTable,
    #[serde(default)]
    sensor: Vec<SensorTable>,
    #[serde(default)]
    prior: Vec<PriorTable>,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum Variant {
    Fixed,
    Moving,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct VarianceTable {
    acceleration: f64,
    net_wrench: f64,
    wrench_balance: f64,
    torque: f64,
    prior: f64,
    /// Wrench of the seat on a moving base; as `prior` if not given.
    prior_base: Option<f64>,
}

impl Default for VarianceTable {
    fn default() -> Self {
        Self { acceleration: 1e-4, net_wrench: 1e-4, wrench_balance: 1e-4, torque: 1e-4, prior: 1e4, prior_base: None }
    }
}

/// How well the body is known, as in the parameters `scatter.*` of the seated body.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ScatterTable {
    mass_std: f64,
    segment_mass_std: f64,
    segment_com_std: f64,
    segment_inertia_std: f64,
    inclination_std: f64,
}

impl Default for ScatterTable {
    fn default() -> Self {
        let ScatterParameters { mass_std, segment_mass_std, segment_com_std, segment_inertia_std, inclination_std } =
            ScatterParameters::default();
        Self { mass_std, segment_mass_std, segment_com_std, segment_inertia_std, inclination_std }
    }
}

impl ScatterTable {
    /// The parameters; what is out of range is an error that names it.
    fn parameters(&self) -> Result<ScatterParameters, String> {
        let Self { mass_std, segment_mass_std, segment_com_std, segment_inertia_std, inclination_std } = *self;
        let parameters =
            ScatterParameters { mass_std, segment_mass_std, segment_com_std, segment_inertia_std, inclination_std };
        parameters.validate().map_err(|error| format!("scatter: {error}"))?;
        Ok(parameters)
    }
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum VarianceValue {
    One(f64),
    PerRow(Vec<f64>),
    Full(Vec<Vec<f64>>),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorTable {
    #[serde(rename = "type")]
    kind: String,
    name: Option<String>,
    link: Option<String>,
    joint: Option<String>,
    #[serde(default)]
    xyz: [f64; 3],
    #[serde(default)]
    rpy: [f64; 3],
    variance: VarianceValue,
    columns: Option<Vec<String>>,
    value: Option<f64>,
}

/// A prior of the external wrench on one link: variances of force and moment.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PriorTable {
    link: String,
    force: f64,
    moment: f64,
}

/// Where the samples of a sensor come from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Columns of the log, one per row.
    Columns(Vec<String>),
    /// The same number in all rows.
    Value(f64),
}

/// An estimator of a body with the places its samples come from.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The estimator.
    pub body: WholeBody,
    /// Source of each sensor's samples.
    pub sources: Vec<Source>,
    /// Whether the base moves.
    pub moving: bool,
    /// What is unusual about the model, one line each.
    pub warnings: Vec<String>,
}

/// Builds the estimator of a body from `sensors.toml`.
pub fn read(description: &Description, model: &Path, path: &Path) -> Result<Setup, EstimateError> {
    let file = path.display().to_string();
    let fail = |what: String| EstimateError::new(&file, what);
    let text = std::fs::read_to_string(path).map_err(|e| fail(format!("cannot be read: {e}")))?;
    let config: File = toml::from_str(&text).map_err(|e| {
        let line = e.span().map_or(1, |span| text[..span.start].matches('\n').count() + 1);
        EstimateError::new(&format!("{file}:{line}"), e.message().replace('\n', " "))
    })?;
    let refused = |error: ModelError| blame(&error, model, &file);

    let mut sensors = vec![];
    let mut sources = vec![];
    for table in &config.sensor {
        let (sensor, source) = sensor(table).map_err(&fail)?;
        sensors.push(sensor);
        sources.push(source);
    }
    let keep = used_links(description, &sensors, &config.prior);
    let keep: Vec<&str> = keep.iter().map(String::as_str).collect();
    let tree = Tree::new(description, &config.base, config.compact, &keep).map_err(refused)?;
    let warnings = tree.warnings.iter().map(|w| format!("{}: {w}", model.display())).collect();

    let v = &config.variance;
    let mut variances = Variances {
        equation: [v.acceleration, v.net_wrench, v.wrench_balance, v.torque],
        prior: [v.prior; 6],
        ..Default::default()
    };
    if let Some(base) = v.prior_base {
        variances.prior_of.push((0, Kind::ParentWrench, [base; 2]));
    }
    for prior in &config.prior {
        let place = tree.place(&prior.link).map_err(refused)?;
        variances.prior_of.push((place.body, Kind::ExternalWrench, [prior.force, prior.moment]));
    }
    let gravity = config.gravity.unwrap_or([0.0, 0.0, -STANDARD_GRAVITY]);
    if !gravity.iter().all(|g| g.is_finite()) {
        return Err(fail("gravity: is not finite".to_owned()));
    }
    let moving = config.variant == Variant::Moving;
    let base = if moving { Base::Moving } else { Base::Fixed(Vector3::from(gravity)) };
    let scatter = config.scatter.parameters().map_err(&fail)?;
    let body = WholeBody::new(tree, base, sensors, &variances).map_err(refused)?.considering(&scatter);
    Ok(Setup { body, sources, moving, warnings })
}

/// The file an error of the model is about: what the sensors' file asks for, or the body itself.
fn blame(error: &ModelError, model: &Path, sensors: &str) -> EstimateError {
    let about_sensors = matches!(
        error,
        ModelError::UnknownLink(_)
            | ModelError::UnknownJoint(_)
            | ModelError::FixedJoint(_)
            | ModelError::SensorOnFixedBase(..)
            | ModelError::BaseIsFixed(_)
            | ModelError::BadVariance(..)
            | ModelError::CovarianceNotSpd(_)
            | ModelError::VarianceCount(..)
    );
    let model = model.display().to_string();
    let of_model = match error {
        ModelError::UnknownLink(_) | ModelError::UnknownJoint(_) => format!(" in {model}"),
        _ => String::new(),
    };
    if about_sensors {
        EstimateError::new(sensors, format!("{error}{of_model}"))
    } else {
        EstimateError::new(&model, error.to_string())
    }
}

fn sensor(table: &SensorTable) -> Result<(Sensor, Source), String> {
    let Some((quantity, _)) = Quantity::ALL.iter().find(|(_, word)| *word == table.kind) else {
        let known: Vec<_> = Quantity::ALL.iter().map(|(_, word)| *word).collect();
        return Err(format!("there is no sensor type '{}'; there are {}", table.kind, known.join(", ")));
    };
    let target = match (quantity.attachment(), &table.link, &table.joint) {
        (Attachment::Link, Some(link), None) => link.clone(),
        (Attachment::Joint, None, Some(joint)) => joint.clone(),
        (Attachment::Base, None, None) => String::new(),
        (attachment, ..) => {
            let wanted = match attachment {
                Attachment::Link => "a link and no joint",
                Attachment::Joint => "a joint and no link",
                Attachment::Base => "neither link nor joint",
            };
            let given = table.link.as_ref().or(table.joint.as_ref());
            let at = given.map_or(String::new(), |name| format!(" (at '{name}')"));
            return Err(format!("a sensor of type {}{at} needs {wanted}", table.kind));
        }
    };
    let noise = match &table.variance {
        VarianceValue::One(v) => Noise::Scalar(*v),
        VarianceValue::PerRow(v) => Noise::Diagonal(v.clone()),
        VarianceValue::Full(rows) => Noise::Full(rows.concat()),
    };
    let mut sensor = Sensor::new(*quantity, &target, noise);
    if let Some(name) = &table.name {
        sensor.name = format!("{name}' at '{target}");
    }
    if !table.xyz.iter().chain(&table.rpy).all(|v| v.is_finite()) {
        return Err(format!("sensor '{}': xyz or rpy is not finite", sensor.name));
    }
    sensor.pose = Pose::from_xyz_rpy(&table.xyz, &table.rpy);
    let source = match (&table.columns, table.value) {
        (Some(columns), None) if columns.len() == quantity.rows() => Source::Columns(columns.clone()),
        (Some(columns), None) => {
            let (n, rows) = (columns.len(), quantity.rows());
            return Err(format!("sensor '{}' has {n} columns for {rows} rows", sensor.name));
        }
        (None, Some(value)) => Source::Value(value),
        _ => return Err(format!("sensor '{}' needs either columns or value", sensor.name)),
    };
    Ok((sensor, source))
}

/// Links whose frames are used and that must stay bodies of their own in a compact tree.
fn used_links(description: &Description, sensors: &[Sensor], priors: &[PriorTable]) -> Vec<String> {
    let mut used: Vec<String> = priors.iter().map(|prior| prior.link.clone()).collect();
    for sensor in sensors {
        match sensor.quantity.attachment() {
            Attachment::Link => used.push(sensor.target.clone()),
            Attachment::Joint if sensor.quantity == Quantity::JointWrench => {
                let joint = description.joints.iter().find(|joint| joint.name == sensor.target);
                used.extend(joint.map(|joint| joint.child.clone()));
            }
            _ => {}
        }
    }
    used
}
