//! `fmu/VARIABLES.md` and the JSON schema agree with the declarations.

use std::path::Path;
use wheelstate_fmu::describe::{markdown, schema};
use wheelstate_fmu::model::models;

#[test]
fn the_list_of_variables_is_up_to_date() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("VARIABLES.md");
    let declared = markdown::variables(&models(&|_| true));
    if std::env::var_os("WHEELSTATE_UPDATE").is_some() {
        std::fs::write(&path, &declared).unwrap();
    }
    let written = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        written == declared,
        "{} is not what the declarations say; WHEELSTATE_UPDATE=1 cargo test -p wheelstate-fmu variables rewrites it",
        path.display()
    );
}

#[test]
fn the_schema_carries_ranges_and_choices() {
    let model = models(&|name| name == "NursingRobot").remove(0);
    let schema = schema::schema(&model);
    let mass = &schema["properties"]["parameters"]["properties"]["robot.mass"]["properties"]["value"];
    assert_eq!(mass["type"], "number");
    assert!(mass["minimum"].as_f64().unwrap() > 0.0);
    let law = &schema["properties"]["parameters"]["properties"]["mass.law"]["properties"]["value"];
    assert!(law["enum"].as_array().unwrap().iter().any(|item| item == "exponential"));
    assert_eq!(schema["properties"]["vehicle"]["const"], "nursing-robot");
}
