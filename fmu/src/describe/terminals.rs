//! `terminalsAndIcons/terminalsAndIcons.xml`: inputs and outputs as two buses, so that a tool connects a machine's
//! sensors by one line. FMI 2.0.4 takes the file's format from FMI 3.0.

use crate::model::Model;
use std::fmt::Write as _;

/// The terminals of a model.
pub fn xml(model: &Model) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiTerminalsAndIcons fmiVersion=\"3.0\">\n  <Terminals>\n",
    );
    let terminals = [
        ("sensors", "What the machine measures and is commanded.", &model.inputs),
        ("estimates", "What the estimator gives.", &model.outputs),
    ];
    for (name, about, list) in terminals {
        let _ = writeln!(text, r#"    <Terminal name="{name}" matchingRule="bus" description="{about}">"#);
        for variable in list {
            let name = &variable.name;
            let _ = writeln!(
                text,
                r#"      <TerminalMemberVariable variableName="{name}" memberName="{name}" variableKind="signal"/>"#
            );
        }
        text.push_str("    </Terminal>\n");
    }
    text + "  </Terminals>\n</fmiTerminalsAndIcons>\n"
}
