//! Rules for the declared variables and the XML that no validator checks.

use crate::support::Lag;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use wheelstate::variable::Kind;
use wheelstate::{Status, unit};
use wheelstate_fmu::describe::{guid, xml};
use wheelstate_fmu::instance::Instance;
use wheelstate_fmu::model::{Model, Place, Type, models, shown_start};
use wheelstate_fmu::pack::picture;

fn all() -> Vec<Model> {
    let mut list = models(&|_| true);
    list.push(Model::of::<Lag>());
    list
}

#[test]
fn every_declaration_is_complete_and_sound() {
    for model in all() {
        let mut names: BTreeSet<String> = BTreeSet::new();
        let groups = [(&model.parameters, 'p'), (&model.inputs, 'i'), (&model.outputs, 'o')];
        for (list, group) in groups {
            assert!(list.len() < 10_000);
            for variable in list {
                let what = format!("{} {}", model.name, variable.name);
                assert!(names.insert(variable.name.clone()), "{what} is declared twice");
                let words = variable.name.split(['.', '_']);
                let plain = |word: &str| word.bytes().all(|b| b.is_ascii_alphanumeric()) && !word.is_empty();
                assert!(words.into_iter().all(plain) && !variable.name.as_bytes()[0].is_ascii_digit(), "{what}");
                assert!(group == 'p' || !variable.name.contains('.'), "{what}: flat names");
                assert!(variable.description.len() > 3 && !variable.description.contains('#'), "{what}");
                assert!(unit::parse(variable.unit).is_some(), "{what}: unit {}", variable.unit);
                let (low, high) = variable.range;
                assert!(low < high, "{what}");
                let missing = group == 'i' && variable.may_be_missing() && variable.start.is_nan();
                assert!(missing || (low..=high).contains(&variable.start), "{what}: start {}", variable.start);
                assert!(group == 'p' || !variable.tunable, "{what}: only parameters are tunable");
                assert!(group == 'i' || !variable.may_be_missing(), "{what}: only inputs are measured");
                if let Kind::Choice(items) = variable.kind {
                    assert_eq!(items.iter().collect::<BTreeSet<_>>().len(), items.len(), "{what}");
                }
            }
        }
    }
}

#[test]
fn every_model_has_what_all_models_have() {
    for model in models(&|_| true) {
        let output = |name: &str| model.outputs.iter().find(|variable| variable.name == name);
        assert_eq!(output("status").map(|v| v.kind), Some(Kind::Integer), "{}", model.name);
        assert_eq!(output("healthy").map(|v| v.kind), Some(Kind::Boolean), "{}", model.name);
        let (_, period) = model.parameter("sample_period").unwrap();
        assert!(!period.tunable && period.unit == "s" && period.range.0 > 0.0, "{}", model.name);
        assert!(model.outputs.iter().any(|variable| variable.name.ends_with("_std")), "{}", model.name);
    }
}

#[test]
fn an_infinite_sample_is_said_to_be_one() {
    for model in models(&|_| true) {
        for (i, input) in model.inputs.iter().enumerate().filter(|(_, input)| input.measured) {
            // sensors of the body that are not switched on are ignored
            let off = ["seat_", "imu_", "right_hand", "left_hand", "right_foot", "left_foot"];
            if model.name == "HumanDynamics" && off.iter().any(|sensor| input.name.starts_with(sensor)) {
                continue;
            }
            let mut instance = Instance::new(model.clone(), "guid");
            instance.enter_initialization();
            instance.exit_initialization().unwrap();
            instance.set(Type::Real, &[Place::Input(i).reference()], |_| f64::NEG_INFINITY).unwrap();
            instance.do_step(0.0, model.sample_period()).unwrap();
            let place = model.outputs.iter().position(|output| output.name == "status").map(Place::Output).unwrap();
            let mut status = 0.0;
            instance.get(Type::Integer, &[place.reference()], |_, value| status = value).unwrap();
            assert_ne!(status as u32 & Status::INFINITE.bits(), 0, "{} {}: {status}", model.name, input.name);
        }
    }
}

#[test]
fn no_source_of_the_fmu_names_a_machine() {
    fn sources(folder: &Path, list: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { sources(&path, list) } else { list.push(path) }
        }
    }
    let mut files = Vec::new();
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut files);
    assert!(files.len() > 20);
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap().to_lowercase();
        for model in models(&|_| true) {
            for name in [model.name.to_lowercase(), model.command_name(), model.command_name().replace('-', "_")] {
                assert!(!text.contains(&name), "{} names {name}", file.display());
            }
        }
    }
}

#[test]
fn every_machine_has_its_picture_and_one_that_has_none_gets_no_other() {
    let pictures: BTreeSet<_> = models(&|_| true).iter().map(|model| picture(model).expect(model.name)).collect();
    assert_eq!(pictures.len(), models(&|_| true).len());
    assert!(picture(&Model::of::<Lag>()).is_none());
}

#[test]
fn value_references_lead_back_to_their_places() {
    for model in all() {
        let sizes = [model.parameters.len(), model.inputs.len(), model.outputs.len()];
        let makers = [Place::Parameter, Place::Input, Place::Output];
        for (size, make) in sizes.into_iter().zip(makers) {
            for index in 0..size {
                assert_eq!(model.place(make(index).reference()), Some(make(index)));
            }
            assert_eq!(model.place(make(size).reference()), None);
        }
        assert_eq!((model.place(0), model.place(1), model.place(u32::MAX)), (None, None, None));
    }
    // part of the interface: masters may have stored them
    assert_eq!(
        (Place::Parameter(3).reference(), Place::Input(0).reference(), Place::Output(7).reference()),
        (10_003, 20_000, 30_007)
    );
}

#[test]
fn the_guid_tells_interface_from_start_values() {
    let model = Model::of::<Lag>();
    let plain = guid::of(&model);
    assert_eq!(plain.len(), 38);
    let mut tuned = model.clone();
    tuned.bake(&[(1, 0.25)]).unwrap();
    let baked = guid::of(&tuned);
    assert_eq!(plain[..19], baked[..19]);
    assert_ne!(plain[19..], baked[19..]);
    let mut changed = model.clone();
    changed.outputs[0].description.to_mut().push('!');
    assert_ne!(guid::of(&changed)[..19], plain[..19]);
    assert_eq!(guid::of(&changed)[19..], plain[19..]);
    let guids: BTreeSet<_> = all().iter().map(guid::of).collect();
    assert_eq!(guids.len(), all().len());
}

#[test]
fn baking_is_all_or_nothing_and_only_what_the_model_accepts() {
    let mut model = Model::of::<Lag>();
    let before = Model::starts(&model.parameters);
    let (time_constant, _) = model.parameter("filter.time_constant").unwrap();
    let (gain, _) = model.parameter("filter.gain").unwrap();
    for (values, word) in [
        (vec![(gain, 3.0), (time_constant, f64::NAN)], "filter.time_constant"),
        (vec![(gain, 3.0), (time_constant, 0.005)], "shorter than sample_period"),
        (vec![(gain, 300.0)], "filter.gain"),
    ] {
        let error = model.bake(&values).unwrap_err();
        assert!(error.contains(word), "{error}");
        assert_eq!(Model::starts(&model.parameters), before);
    }
}

#[test]
fn every_start_in_the_xml_is_finite_and_in_its_range() {
    for model in all() {
        let text = xml(&model);
        for number in text.split("start=\"").skip(1).map(|rest| &rest[..rest.find('"').unwrap()]) {
            assert!(matches!(number, "true" | "false") || number.parse::<f64>().unwrap().is_finite(), "{number}");
        }
        for variable in model.parameters.iter().chain(&model.inputs) {
            let (low, high) = variable.range;
            assert!((low..=high).contains(&shown_start(variable)), "{} {}", model.name, variable.name);
        }
    }
}

#[test]
fn a_host_can_switch_every_sensor_off_and_name_a_number_for_no_sample() {
    for model in all() {
        assert!(model.parameter("missing_value").is_some());
        let switches: Vec<_> = model.parameters.iter().filter(|v| v.name.starts_with("use.")).collect();
        assert!(!switches.is_empty() && switches.iter().all(|v| v.kind == Kind::Boolean), "{}", model.name);
        let own = model.parameters.iter().position(|v| v.name == "missing_value").unwrap();
        if !model.parameters[..own].iter().any(|v| v.name.starts_with("use.")) {
            let measured = model.inputs.iter().filter(|v| v.may_be_missing()).count();
            assert_eq!(switches.len(), measured, "{}", model.name);
        }
    }
}

#[test]
fn the_xml_escapes_texts() {
    let text = xml(&Model::of::<Lag>());
    assert!(text.contains("Time constant of the &quot;lag&quot; &lt;T&gt;."));
    assert!(text.contains(r#"name="signal" valueReference="20000""#));
    assert!(text.contains(r#"<Enumeration declaredType="FilterFaultChoice" start="1"/>"#));
}
