//! The shared libraries that go into an FMU.

use super::PackError;
use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A shared library for one platform.
#[derive(Clone, Debug)]
pub struct Library {
    /// Name of the folder below `binaries`, as `linux64`.
    pub platform: String,
    /// The file.
    pub path: PathBuf,
}

/// Folders below `binaries` that hosts look into: those of FMI 2.0, and the name under which newer
/// hosts look for 64-bit ARM.
const PLATFORMS: [&str; 7] = ["linux64", "win64", "darwin64", "linux32", "win32", "darwin32", "aarch64-linux"];

impl Library {
    /// A further library, as `win64=path/to/wheelstate_fmu.dll`.
    pub fn parse(text: &str) -> Result<Self, String> {
        let Some((platform, path)) = text.split_once('=') else {
            return Err("platform=library is expected, as in win64=target/wheelstate_fmu.dll".to_owned());
        };
        if !PLATFORMS.contains(&platform) {
            return Err(format!("'{platform}' is no platform of an FMU; there are: {}", PLATFORMS.join(", ")));
        }
        if !Path::new(path).is_file() {
            return Err(format!("there is no file '{path}'"));
        }
        Ok(Self { platform: platform.to_owned(), path: path.into() })
    }

    /// The library that was built together with this program, which stands beside it.
    pub fn own() -> Result<Self, PackError> {
        let name = format!("{DLL_PREFIX}wheelstate_fmu{DLL_SUFFIX}");
        let program =
            std::env::current_exe().map_err(|error| PackError(format!("cannot find this program: {error}")))?;
        let folder = program.parent().unwrap_or(Path::new("."));
        // cargo leaves the library in one of the two, depending on what was asked of it
        let candidates = [folder.join(&name), folder.join("deps").join(&name)];
        let newest = candidates.iter().filter(|path| path.is_file()).max_by_key(|path| modified(path));
        let path = newest.cloned().ok_or_else(|| {
            let folder = folder.display();
            PackError(format!("{name} is not in {folder}; build it: cargo build --release -p wheelstate-fmu"))
        })?;
        let platform = match (std::env::consts::OS, std::env::consts::ARCH) {
            ("linux", "x86_64") => "linux64",
            ("linux", "aarch64") => "aarch64-linux",
            ("windows", "x86_64") => "win64",
            ("macos", _) => "darwin64",
            (system, machine) => return Err(PackError(format!("FMI 2.0 has no platform for {machine} {system}"))),
        };
        Ok(Self { platform: platform.to_owned(), path })
    }

    /// The ending that hosts on this platform expect.
    pub fn suffix(&self) -> &'static str {
        match self.platform.as_str() {
            platform if platform.starts_with("win") => ".dll",
            platform if platform.starts_with("darwin") => ".dylib",
            _ => ".so",
        }
    }
}

fn modified(path: &Path) -> SystemTime {
    path.metadata().and_then(|data| data.modified()).unwrap_or(SystemTime::UNIX_EPOCH)
}
