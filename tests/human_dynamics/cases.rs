//! Reference cases: models, sensors and expected estimates from the vectors.
#![allow(dead_code)]

use crate::support::vector_text;
use nalgebra::Vector3;
use serde_json::Value;
use wheelstate::estimator::human_dynamics::whole_body::{Posture, WholeBody};
use wheelstate::estimator::human_dynamics::{HumanDynamics, Inputs, Outputs, Parameters};
use wheelstate::model::multibody::equations::{Base, Kind};
use wheelstate::model::multibody::prior::Variances;
use wheelstate::model::multibody::sensors::{Noise, Quantity, Sensor};
use wheelstate::model::multibody::spatial::Pose;
use wheelstate::model::multibody::tree::{Description, Joint, JointKind, Link, Tree};
use wheelstate::{Estimator, Variables};

pub const CASES: [&str; 22] = [
    "chain3_fixed_L1",
    "chain3_fixed_L2",
    "chain3_fixed_L3",
    "chain3_fixed_missing",
    "chain3_fixed_stiff",
    "chain3_moving_L1",
    "chain3_moving_L2",
    "chain3_moving_L3",
    "human48_LeftFoot_fixed_L1",
    "human48_LeftFoot_fixed_L3",
    "human48_LeftFoot_fixed_stiff",
    "human48_Pelvis_moving_compact",
    "seated12_fixed_L1",
    "seated12_fixed_L2",
    "seated12_fixed_L3",
    "seated12_fixed_compact",
    "seated12_moving_L1",
    "seated12_moving_L2",
    "seated12_moving_L3",
    "seated12_moving_compact",
    "seated12_moving_missing",
    "seated12_moving_stiff",
];

pub fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(list) => list.iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect(),
        _ => vec![value.as_f64().unwrap_or(f64::NAN)],
    }
}

pub fn array<const N: usize>(value: &Value) -> [f64; N] {
    numbers(value).try_into().unwrap()
}

pub fn text(value: &Value) -> String {
    value.as_str().unwrap().to_owned()
}

pub fn description(value: &Value) -> Description {
    let list = |key: &str| value[key].as_array().unwrap().clone();
    Description {
        name: text(&value["name"]),
        links: (list("links").iter())
            .map(|l| Link {
                name: text(&l["name"]),
                mass: l["mass"].as_f64().unwrap(),
                com: array(&l["com"]),
                inertia: array(&l["inertia"]),
            })
            .collect(),
        joints: (list("joints").iter())
            .map(|j| Joint {
                name: text(&j["name"]),
                kind: match j["type"].as_str().unwrap() {
                    "revolute" | "continuous" => JointKind::Revolute,
                    "prismatic" => JointKind::Prismatic,
                    "fixed" => JointKind::Fixed,
                    other => JointKind::Other(other.to_owned()),
                },
                parent: text(&j["parent"]),
                child: text(&j["child"]),
                xyz: array(&j["xyz"]),
                rpy: array(&j["rpy"]),
                axis: array(&j["axis"]),
            })
            .collect(),
    }
}

pub fn model(name: &str) -> Description {
    let name = name.split('_').next().unwrap();
    description(&serde_json::from_str(&vector_text(&format!("human_dynamics/model_{name}.json"))).unwrap())
}

pub struct Case {
    pub data: Value,
    pub body: WholeBody,
    pub q: Vec<f64>,
    pub qd: Vec<f64>,
    pub base_rate: [f64; 3],
    pub samples: Vec<f64>,
    pub mean: Vec<f64>,
    pub variance: Vec<f64>,
}

pub fn sensors(data: &Value) -> Vec<Sensor> {
    let list = data["sensors"].as_array().unwrap().iter();
    list.map(|s| {
        let kind = s["type"].as_str().unwrap();
        let quantity = Quantity::ALL.iter().find(|(_, word)| *word == kind).unwrap().0;
        let target = s.get("link").or(s.get("joint")).and_then(Value::as_str).unwrap_or("");
        let noise = match &s["var"] {
            Value::Array(_) => Noise::Diagonal(numbers(&s["var"])),
            v => Noise::Scalar(v.as_f64().unwrap()),
        };
        let or_zero = |key: &str| s.get(key).map_or([0.0; 3], array);
        let pose = Pose::from_xyz_rpy(&or_zero("xyz"), &or_zero("rpy"));
        Sensor { name: text(&s["name"]), ..Sensor::new(quantity, target, noise) }.at(pose)
    })
    .collect()
}

pub fn samples(data: &Value) -> Vec<f64> {
    data["sensors"].as_array().unwrap().iter().flat_map(|s| numbers(&s["y"])).collect()
}

pub fn variances(data: &Value) -> Variances {
    Variances {
        equation: [data["var_model"].as_f64().unwrap(); 4],
        prior: [data["prior_var"].as_f64().unwrap(); 6],
        mean: data["prior_mean"].as_f64().unwrap(),
        ..Default::default()
    }
}

/// The links whose frames the sensors use.
pub fn used_links(description: &Description, sensors: &[Sensor]) -> Vec<String> {
    let carried = |s: &Sensor| description.joints.iter().find(|j| j.name == s.target).map(|j| j.child.clone());
    (sensors.iter())
        .filter_map(|s| match s.quantity {
            Quantity::JointWrench => carried(s),
            Quantity::JointTorque | Quantity::JointAcceleration => None,
            _ => Some(s.target.clone()),
        })
        .collect()
}

pub fn case(name: &str) -> Case {
    let data: Value = serde_json::from_str(&vector_text(&format!("human_dynamics/{name}.json"))).unwrap();
    case_of(data)
}

pub fn case_of(data: Value) -> Case {
    let description = model(data["model"].as_str().unwrap());
    let sensors = sensors(&data);
    let used = used_links(&description, &sensors);
    let keep: Vec<&str> = used.iter().map(String::as_str).collect();
    let tree =
        Tree::new(&description, data["base"].as_str().unwrap(), data["compact"].as_bool().unwrap(), &keep).unwrap();
    let base = match data["variant"].as_str().unwrap() {
        "fixed" => Base::Fixed(Vector3::from(array::<3>(&data["gravity"]))),
        _ => Base::Moving,
    };
    let order = data["dof_names"].as_array().unwrap().iter().map(text).collect::<Vec<_>>();
    let by_name = |key: &str| {
        let values = numbers(&data[key]);
        tree.dof_names.iter().map(|n| values[order.iter().position(|o| o == n).unwrap()]).collect::<Vec<_>>()
    };
    let (q, qd) = (by_name("q"), by_name("qd"));
    let base_rate = if data["base_w"].is_null() { [0.0; 3] } else { array(&data["base_w"]) };
    let names: Vec<String> = data["bodies"].as_array().unwrap().iter().map(text).collect();
    assert_eq!(tree.bodies.iter().map(|b| b.name.clone()).collect::<Vec<_>>(), names);
    let body = WholeBody::new(tree, base, sensors, &variances(&data)).unwrap();
    check_layout(&data, &body);
    let (mean, variance) = (numbers(&data["expected_mean"]), numbers(&data["expected_var"]));
    Case { samples: samples(&data), body, q, qd, base_rate, mean, variance, data }
}

fn check_layout(data: &Value, body: &WholeBody) {
    let tree = body.equations().tree();
    for entry in data["layout"].as_array().unwrap() {
        let b = tree.bodies.iter().position(|b| b.name == entry[0].as_str().unwrap()).unwrap();
        let word = entry[1].as_str().unwrap();
        let kind = ["a", "fB", "f", "tau", "fx", "qdd"].iter().position(|k| *k == word).unwrap();
        let range = body.equations().slots()[b].unwrap().range(Kind::ALL[kind]);
        assert_eq!(range.start as u64, entry[2].as_u64().unwrap());
        assert_eq!(range.end as u64, entry[3].as_u64().unwrap());
    }
}

impl Case {
    pub fn step(&mut self, variances: bool) -> wheelstate::Status {
        let posture = Posture { q: &self.q, qd: &self.qd, base_rate: self.base_rate };
        self.body.step(&posture, &self.samples, variances).unwrap()
    }
    pub fn step_by_qr(&mut self) -> wheelstate::Status {
        let posture = Posture { q: &self.q, qd: &self.qd, base_rate: self.base_rate };
        self.body.step_by_qr(&posture, &self.samples, true).unwrap()
    }
}

pub fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

pub fn largest_relative(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / b.abs()).fold(0.0, f64::max)
}

/// Everything measured on a person who sits upright and still with nothing in the hands.
pub fn sitting() -> wheelstate::estimator::human_dynamics::Inputs {
    let up = [0.0, 0.0, 9.80665];
    let mut inputs = wheelstate::estimator::human_dynamics::Inputs::default();
    wheelstate::Variables::map(&mut inputs, &mut |_| 0.0);
    (inputs.base_accel, inputs.imu) = (up, [up; 4]);
    inputs
}

/// The seated body with these parameters.
pub fn estimator(set: &[(&str, f64)]) -> HumanDynamics {
    let mut parameters = Parameters::default();
    for (name, value) in set {
        parameters.set(name, *value).unwrap();
    }
    HumanDynamics::new(&parameters).unwrap()
}

/// Its estimates now.
pub fn outputs(estimator: &HumanDynamics, inputs: &Inputs) -> Outputs {
    let mut outputs = Outputs::default();
    estimator.outputs(inputs, 0.0, &mut outputs);
    outputs
}

/// Every sensor that is not on by default.
pub const ALL: [(&str, f64); 4] =
    [("use.seat_wrench", 1.0), ("use.imu", 1.0), ("use.hand_wrench", 1.0), ("use.foot_wrench", 1.0)];
