//! Our FMUs through the `fmi` crate, and our signatures against the official headers.
#![allow(unsafe_code)]

use crate::support::random;
use fmi::fmi2::binding;
use fmi::fmi2::import::Fmi2Import;
use fmi::fmi2::instance::{CoSimulation, Common};
use fmi::traits::FmiImport;
use wheelstate_fmu::abi;
use wheelstate_fmu::model::{Model, Place, Type, models};
use wheelstate_fmu::pack::{library::Library, write};

// The compiler compares each of our functions with the type in the official headers.
// fmi2Instantiate differs in name only: its struct of callbacks is compared by layout below.
const _: binding::fmi2GetTypesPlatformTYPE = Some(abi::fmi2GetTypesPlatform);
const _: binding::fmi2GetVersionTYPE = Some(abi::fmi2GetVersion);
const _: binding::fmi2SetDebugLoggingTYPE = Some(abi::fmi2SetDebugLogging);
const _: binding::fmi2FreeInstanceTYPE = Some(abi::fmi2FreeInstance);
const _: binding::fmi2SetupExperimentTYPE = Some(abi::fmi2SetupExperiment);
const _: binding::fmi2EnterInitializationModeTYPE = Some(abi::fmi2EnterInitializationMode);
const _: binding::fmi2ExitInitializationModeTYPE = Some(abi::fmi2ExitInitializationMode);
const _: binding::fmi2TerminateTYPE = Some(abi::fmi2Terminate);
const _: binding::fmi2ResetTYPE = Some(abi::fmi2Reset);
const _: binding::fmi2GetRealTYPE = Some(abi::fmi2GetReal);
const _: binding::fmi2GetIntegerTYPE = Some(abi::fmi2GetInteger);
const _: binding::fmi2GetBooleanTYPE = Some(abi::fmi2GetBoolean);
const _: binding::fmi2GetStringTYPE = Some(abi::fmi2GetString);
const _: binding::fmi2SetRealTYPE = Some(abi::fmi2SetReal);
const _: binding::fmi2SetIntegerTYPE = Some(abi::fmi2SetInteger);
const _: binding::fmi2SetBooleanTYPE = Some(abi::fmi2SetBoolean);
const _: binding::fmi2SetStringTYPE = Some(abi::fmi2SetString);
const _: binding::fmi2GetFMUstateTYPE = Some(abi::fmi2GetFMUstate);
const _: binding::fmi2SetFMUstateTYPE = Some(abi::fmi2SetFMUstate);
const _: binding::fmi2FreeFMUstateTYPE = Some(abi::fmi2FreeFMUstate);
const _: binding::fmi2SerializedFMUstateSizeTYPE = Some(abi::fmi2SerializedFMUstateSize);
const _: binding::fmi2GetDirectionalDerivativeTYPE = Some(abi::fmi2GetDirectionalDerivative);
const _: binding::fmi2SetRealInputDerivativesTYPE = Some(abi::fmi2SetRealInputDerivatives);
const _: binding::fmi2GetRealOutputDerivativesTYPE = Some(abi::fmi2GetRealOutputDerivatives);
const _: binding::fmi2DoStepTYPE = Some(abi::fmi2DoStep);
const _: binding::fmi2CancelStepTYPE = Some(abi::fmi2CancelStep);
const _: binding::fmi2GetStatusTYPE = Some(abi::fmi2GetStatus);
const _: binding::fmi2GetRealStatusTYPE = Some(abi::fmi2GetRealStatus);
const _: binding::fmi2GetIntegerStatusTYPE = Some(abi::fmi2GetIntegerStatus);
const _: binding::fmi2GetBooleanStatusTYPE = Some(abi::fmi2GetBooleanStatus);
const _: binding::fmi2GetStringStatusTYPE = Some(abi::fmi2GetStringStatus);

#[test]
fn the_callbacks_have_the_layout_of_the_headers() {
    assert_eq!(size_of::<abi::Callbacks>(), size_of::<binding::fmi2CallbackFunctions>());
    assert_eq!(align_of::<abi::Callbacks>(), align_of::<binding::fmi2CallbackFunctions>());
    assert_eq!(
        std::mem::offset_of!(abi::Callbacks, logger),
        std::mem::offset_of!(binding::fmi2CallbackFunctions, logger)
    );
    assert_eq!(
        std::mem::offset_of!(abi::Callbacks, environment),
        std::mem::offset_of!(binding::fmi2CallbackFunctions, componentEnvironment)
    );
    assert_eq!(
        [abi::OK, abi::WARNING, abi::DISCARD, abi::ERROR, abi::FATAL],
        [
            binding::fmi2Status_fmi2OK,
            binding::fmi2Status_fmi2Warning,
            binding::fmi2Status_fmi2Discard,
            binding::fmi2Status_fmi2Error,
            binding::fmi2Status_fmi2Fatal
        ]
    );
}

/// The FMU of a model, imported.
fn import(model: &Model) -> Fmi2Import {
    let deps = std::env::current_exe().unwrap().parent().unwrap().to_owned();
    let library = Library { platform: "linux64".to_owned(), path: deps.join("libwheelstate_fmu.so"), content: None };
    let folder = tempfile::tempdir().unwrap();
    fmi::import::from_path(write(model, &[library], folder.path()).unwrap()).unwrap()
}

#[test]
fn the_imported_fmu_is_the_native_estimator_bit_for_bit() {
    for model in models(&|_| true) {
        let reals = |list: &[wheelstate::Variable]| -> Vec<usize> {
            (0..list.len()).filter(|i| Type::of(list[*i].kind) == Type::Real).collect()
        };
        let (inputs, outputs) = (reals(&model.inputs), reals(&model.outputs));
        let input_references: Vec<_> = inputs.iter().map(|i| Place::Input(*i).reference()).collect();
        let output_references: Vec<_> = outputs.iter().map(|i| Place::Output(*i).reference()).collect();
        let period = model.sample_period();
        let mut native = model.machine();
        native.build(&Model::starts(&model.parameters)).unwrap();
        let mut flat = Model::starts(&model.inputs);
        let mut expected = Model::starts(&model.outputs);

        let fmu = import(&model);
        let mut instance = fmu.instantiate_cs("one", false, false).unwrap();
        instance.setup_experiment(None, 0.0, None).unwrap();
        instance.enter_initialization_mode().unwrap();
        instance.exit_initialization_mode().unwrap();
        let mut seed = 5;
        let mut kept = None;
        for k in 0..100 {
            for &i in &inputs {
                let missing = model.inputs[i].measured && random(&mut seed) < 0.1;
                flat[i] = if missing { f64::NAN } else { model.inputs[i].start + 0.3 * random(&mut seed) };
            }
            let given: Vec<_> = inputs.iter().map(|i| flat[*i]).collect();
            instance.set_real(&input_references, &given).unwrap();
            if k == 50 {
                kept = Some(instance.get_fmu_state().unwrap());
            }
            instance.do_step(k as f64 * period, period, true).unwrap();
            native.hold(&flat);
            native.step();
            native.predict(period);
            native.outputs(&mut expected);
            let mut values = vec![0.0; outputs.len()];
            instance.get_real(&output_references, &mut values).unwrap();
            for (i, value) in outputs.iter().zip(&values) {
                assert_eq!(
                    value.to_bits(),
                    expected[*i].to_bits(),
                    "{} {} step {k}",
                    model.name,
                    model.outputs[*i].name
                );
            }
            if k == 50 {
                // back and again: the same bits
                let state = kept.take().unwrap();
                let bytes = instance.serialize_fmu_state(&state).unwrap();
                let copy = instance.deserialize_fmu_state(&bytes).unwrap();
                let _ = instance.set_fmu_state(&copy);
                instance.do_step(k as f64 * period, period, true).unwrap();
                let mut again = vec![0.0; outputs.len()];
                instance.get_real(&output_references, &mut again).unwrap();
                assert_eq!(values, again);
            }
        }
        instance.terminate().unwrap();
    }
}

#[test]
fn wrong_calls_are_errors_of_the_crate() {
    let model = models(&|_| true).remove(0);
    let fmu = import(&model);
    let mut instance = fmu.instantiate_cs("one", false, false).unwrap();
    assert!(instance.do_step(0.0, 0.1, true).is_err());
    assert!(instance.set_real(&[4711], &[0.0]).is_err());
    assert_eq!(fmu.model_description().guid, wheelstate_fmu::describe::guid::of(&model));
}
