//! Writes `.fmu` archives: the same input gives the same bytes.

mod archive;
pub mod fit;
pub mod library;
mod ssv;

use crate::describe::{self, page, resources};
use crate::model::{Model, models};
use library::Library;
use std::path::{Path, PathBuf};

/// Why nothing was written; the message names the file or the parameter.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct PackError(pub String);

/// The model of this name, spelt as the FMU (`NursingRobot`) or as on the command line (`nursing-robot`).
pub fn model(name: &str) -> Result<Model, PackError> {
    let plain = |text: &str| text.to_lowercase().replace(['-', '_'], "");
    models(&|known| plain(known) == plain(name)).pop().ok_or_else(|| {
        let known: Vec<_> = models(&|_| true).iter().map(Model::command_name).collect();
        PackError(format!("there is no model '{name}'; there are: {}, all", known.join(", ")))
    })
}

/// The picture that tools show for a model.
fn picture(name: &str) -> &'static [u8] {
    match name {
        "NursingRobot" => include_bytes!("../../assets/NursingRobot.png"),
        "WheeledRobot" => include_bytes!("../../assets/WheeledRobot.png"),
        "WheelLoader" => include_bytes!("../../assets/WheelLoader.png"),
        "HumanDynamics" => include_bytes!("../../assets/HumanDynamics.png"),
        // also for a model that has none of its own yet
        _ => include_bytes!("../../assets/Wheelchair.png"),
    }
}

/// Writes `<out>/<Model>.fmu` and gives its path. The archive appears whole or not at all.
pub fn write(model: &Model, libraries: &[Library], out: &Path) -> Result<PathBuf, PackError> {
    let mut files = vec![
        ("modelDescription.xml".to_owned(), describe::xml(model).into_bytes(), false),
        ("model.png".to_owned(), picture(model.name).to_vec(), false),
        ("documentation/index.html".to_owned(), page::html(model).into_bytes(), false),
        (format!("resources/{}.ssv", model.name), ssv::text(model).into_bytes(), false),
    ];
    for (name, text) in [
        ("license.txt", include_str!("../../assets/license.txt")),
        ("LICENSE-MIT.txt", include_str!("../../../LICENSE-MIT")),
        ("LICENSE-APACHE.txt", include_str!("../../../LICENSE-APACHE")),
    ] {
        files.push((format!("documentation/licenses/{name}"), text.as_bytes().to_vec(), false));
    }
    let default = self::model(model.name)?;
    let starts = resources::differences(model, &default);
    if !starts.is_empty() {
        files.push((format!("resources/{}", resources::FILE), starts.to_json().into_bytes(), false));
    }
    for library in libraries {
        let bytes = std::fs::read(&library.path)
            .map_err(|error| PackError(format!("library {}: {error}", library.path.display())))?;
        files.push((format!("binaries/{}/{}{}", library.platform, model.name, library.suffix()), bytes, true));
    }
    let path = out.join(format!("{}.fmu", model.name));
    let failed = |error: &dyn std::fmt::Display| PackError(format!("{}: {error}", path.display()));
    let bytes = archive::zip(files).map_err(|error| failed(&error))?;
    std::fs::create_dir_all(out).map_err(|error| failed(&error))?;
    let temporary = out.join(format!(".{}.fmu.{}", model.name, std::process::id()));
    let written = std::fs::write(&temporary, bytes).and_then(|()| std::fs::rename(&temporary, &path));
    if let Err(error) = written {
        // what is left of it is of no use; the first error is the one to report
        let _ = std::fs::remove_file(&temporary);
        return Err(failed(&error));
    }
    Ok(path)
}
