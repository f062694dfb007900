//! What a fit may call identified is what the FMU accepts.

use wheelstate_identify::log::Log;
use wheelstate_identify::problem::FitRequest;
use wheelstate_identify::progress::Progress;
use wheelstate_identify::simulate::Request;
use wheelstate_identify::vehicles;

#[test]
fn every_fitted_parameter_keeps_to_the_range_that_the_fmu_declares() {
    for vehicle in vehicles::ALL {
        let declared = vehicle.parameters();
        for target in (vehicle.problem.targets)(&[]) {
            // The joints of a body tree are no parameters of its FMU.
            let Some(variable) = declared.iter().find(|variable| variable.name == target.name) else {
                assert!(vehicle.body_tree, "{}: {} is no parameter of the FMU", vehicle.name, target.name);
                continue;
            };
            let ((low, high), (from, to)) = (target.range, variable.range);
            assert!(low >= from && high <= to, "{} {}: {low}..{high} in {from}..{to}", vehicle.name, target.name);
            assert_eq!(target.unit, variable.unit, "{} {}", vehicle.name, target.name);
        }
    }
}

/// An accelerometer that is biased by more than a good one makes the rolling resistance negative.
#[test]
fn a_negative_rolling_coefficient_of_a_robot_is_never_identified() {
    let robot = vehicles::ALL.iter().find(|vehicle| vehicle.name == "wheeled-robot").unwrap();
    for (bias, seed) in [(0.0, 1), (0.02, 2), (0.02, 3), (0.05, 4), (0.3, 5), (-0.3, 6)] {
        let mut log: Log = robot.simulate(&Request { scenario: "sine".into(), seed, settings: Vec::new() }).unwrap();
        let accel = log.channels.iter_mut().find(|channel| channel.name == "accel_x").unwrap();
        accel.values.iter_mut().for_each(|value| *value += bias);
        let report = robot.fit(&[log], &FitRequest::default(), &Progress::none()).unwrap();
        let rolling = &report.parameters["rolling.coefficient"];
        println!("bias {bias}: {rolling:?}");
        assert!(!rolling.identified || rolling.value > 0.0, "bias {bias}: {rolling:?}");
        // The speed shows a large bias, which is told; that the resistance is too small to be seen is no contradiction.
        let told = report.notes.iter().any(|line| line.starts_with("accel_x of") && line.contains("than"));
        assert!(bias.abs() < 0.1 || told && !rolling.identified, "bias {bias}: {rolling:?} {:?}", report.notes);
        if bias.abs() < 0.1 {
            assert!(!report.warnings.iter().any(|line| line.contains("rolling")), "bias {bias}: {:?}", report.warnings);
        }
    }
}
