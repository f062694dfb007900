//! The shared libraries that go into an FMU.

use super::PackError;
use std::env::consts::{ARCH, DLL_PREFIX, DLL_SUFFIX, OS};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// A platform of FMUs.
struct Platform {
    /// Name of the folder below `binaries`: those of FMI 2.0, and where it names none, as for ARM, that of FMI 3.0.
    folder: &'static str,
    system: &'static str,
    machine: &'static str,
    /// The folder in which hosts on this platform that do not know its name look instead.
    also: Option<&'static str>,
}

const PLATFORMS: [Platform; 5] = [
    Platform { folder: "linux64", system: "linux", machine: "x86_64", also: None },
    Platform { folder: "win64", system: "windows", machine: "x86_64", also: None },
    Platform { folder: "darwin64", system: "macos", machine: "x86_64", also: None },
    Platform { folder: "aarch64-linux", system: "linux", machine: "aarch64", also: Some("linux64") },
    Platform { folder: "aarch64-darwin", system: "macos", machine: "aarch64", also: Some("darwin64") },
];

/// A shared library for one platform.
#[derive(Clone, Debug)]
pub struct Library {
    /// Name of the folder below `binaries`, as `linux64`.
    pub platform: String,
    /// The file; for a library out of an FMU, the FMU.
    pub path: PathBuf,
    /// The bytes, if the file is not the library itself.
    pub content: Option<Vec<u8>>,
}

fn platform(folder: &str) -> Result<&'static Platform, String> {
    let names = PLATFORMS.map(|platform| platform.folder).join(", ");
    let found = PLATFORMS.iter().find(|platform| platform.folder == folder);
    found.ok_or_else(|| format!("'{folder}' is not a platform of an FMU; there are: {names}"))
}

/// Folders in which a host on this platform looks, with the ending of the library there.
pub(super) fn own_folders() -> Vec<(&'static str, &'static str)> {
    let own = PLATFORMS.iter().find(|platform| (platform.system, platform.machine) == (OS, ARCH));
    let folders = own.into_iter().flat_map(|own| std::iter::once(own.folder).chain(own.also));
    folders.map(|folder| (folder, ending(OS))).collect()
}

/// Ending of the libraries of a system.
fn ending(system: &str) -> &'static str {
    match system {
        "windows" => ".dll",
        "macos" => ".dylib",
        _ => ".so",
    }
}

/// System and machine that a library is for, from the head of its file: ELF, PE or Mach-O of 64 bits.
fn target(bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    let half = |at: usize| bytes.get(at..at + 2).map(|two| u16::from_le_bytes([two[0], two[1]]));
    let word = |at: usize| bytes.get(at..at + 4).map(|four| u32::from_le_bytes([four[0], four[1], four[2], four[3]]));
    match (word(0)?, half(0)?) {
        // "\x7fELF", little-endian of 64 bits; e_machine
        (0x464c_457f, _) if half(4)? == 0x0102 => match half(18)? {
            62 => Some(("linux", "x86_64")),
            183 => Some(("linux", "aarch64")),
            _ => None,
        },
        // MH_MAGIC_64; cputype
        (0xfeed_facf, _) => match word(4)? {
            0x0100_0007 => Some(("macos", "x86_64")),
            0x0100_000c => Some(("macos", "aarch64")),
            _ => None,
        },
        // "MZ"; "PE\0\0" and its machine stand where the word at 0x3c says
        (_, 0x5a4d) => {
            let head = word(0x3c)? as usize;
            (word(head)? == 0x4550 && half(head.checked_add(4)?)? == 0x8664).then_some(("windows", "x86_64"))
        }
        _ => None,
    }
}

impl Library {
    /// A further library, as `win64=path/to/wheelstate_fmu.dll`.
    pub fn parse(text: &str) -> Result<Self, String> {
        let Some((folder, path)) = text.split_once('=') else {
            return Err("platform=library is expected, as in win64=target/wheelstate_fmu.dll".to_owned());
        };
        platform(folder)?;
        let library = Self { platform: folder.to_owned(), path: path.into(), content: None };
        library.read().map(|_| library).map_err(|error| error.to_string())
    }

    /// The libraries of a folder with one folder per platform, as `fmu/targets.sh` fills it.
    pub fn all(folder: &Path) -> Result<Vec<Self>, PackError> {
        let shown = folder.display();
        if !folder.is_dir() {
            return Err(PackError(format!("{shown}: there is no such folder")));
        }
        let mut found = Vec::new();
        for Platform { folder: name, system, .. } in &PLATFORMS {
            let prefix = if *system == "windows" { "" } else { "lib" };
            let path = folder.join(name).join(format!("{prefix}wheelstate_fmu{}", ending(system)));
            if path.is_file() {
                found.push(Self { platform: (*name).to_owned(), path, content: None });
            }
        }
        if found.is_empty() {
            return Err(PackError(format!("{shown} has no library; fmu/targets.sh {shown} builds them")));
        }
        Ok(found)
    }

    /// The libraries of an FMU that was packed with start values of its own machine alone.
    pub fn of_fmu(path: &Path) -> Result<Vec<Self>, PackError> {
        let refuse = |why: String| PackError(format!("{}: {why}", path.display()));
        let file = std::fs::File::open(path).map_err(|error| refuse(error.to_string()))?;
        let mut archive = zip::ZipArchive::new(file).map_err(|error| refuse(error.to_string()))?;
        let names: Vec<String> = archive.file_names().filter_map(|name| Some(name.ok()?.into_owned())).collect();
        let mut found = Vec::new();
        for Platform { folder, system, machine, .. } in &PLATFORMS {
            let Some(name) = names.iter().find(|name| name.starts_with(&format!("binaries/{folder}/"))) else {
                continue;
            };
            let mut bytes = Vec::new();
            let mut entry = archive.by_name(name).map_err(|error| refuse(error.to_string()))?;
            std::io::Read::read_to_end(&mut entry, &mut bytes).map_err(|error| refuse(error.to_string()))?;
            // an ARM library may stand in for another, and stands in its own folder as well
            if target(&bytes) == Some((*system, *machine)) {
                found.push(Self { platform: (*folder).to_owned(), path: path.to_owned(), content: Some(bytes) });
            }
        }
        if found.is_empty() {
            return Err(refuse("it has no library for any platform that is known".to_owned()));
        }
        Ok(found)
    }

    /// The file's content, if it is a library for the platform.
    pub fn read(&self) -> Result<Vec<u8>, PackError> {
        let refuse = |why: String| PackError(format!("library {}: {why}", self.path.display()));
        let bytes = match &self.content {
            Some(bytes) => bytes.clone(),
            None => std::fs::read(&self.path).map_err(|error| refuse(error.to_string()))?,
        };
        let wanted = platform(&self.platform).map_err(&refuse)?;
        match target(&bytes) {
            Some((system, machine)) if (system, machine) == (wanted.system, wanted.machine) => Ok(bytes),
            Some((system, machine)) => {
                Err(refuse(format!("it is for {machine} {system}, so it does not belong in {}", self.platform)))
            }
            None => Err(refuse(format!("it is not a shared library for {}", self.platform))),
        }
    }

    /// Where the library goes in an FMU that holds these: its own folder, and that in which hosts on its platform look
    /// if they do not know its name, unless another library belongs there.
    pub fn folders(&self, all: &[Self]) -> Vec<String> {
        let also = platform(&self.platform).ok().and_then(|platform| platform.also);
        let also = also.filter(|folder| !all.iter().any(|library| library.platform == *folder));
        std::iter::once(self.platform.clone()).chain(also.map(str::to_owned)).collect()
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
        let own = PLATFORMS.iter().find(|platform| (platform.system, platform.machine) == (OS, ARCH));
        let own = own.ok_or_else(|| PackError(format!("an FMU has no platform for {ARCH} {OS}")))?;
        Ok(Self { platform: own.folder.to_owned(), path, content: None })
    }

    /// Whether the system refuses the library if its bytes are changed.
    pub fn is_signed(&self) -> bool {
        platform(&self.platform).is_ok_and(|platform| platform.system == "macos")
    }

    /// The ending that hosts on this platform expect.
    pub fn suffix(&self) -> &'static str {
        platform(&self.platform).map_or(".so", |platform| ending(platform.system))
    }
}

fn modified(path: &Path) -> SystemTime {
    path.metadata().and_then(|data| data.modified()).unwrap_or(SystemTime::UNIX_EPOCH)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn library(platform: &str) -> Library {
        Library { platform: platform.to_owned(), path: PathBuf::new(), content: None }
    }

    #[test]
    fn an_arm_library_stands_in_where_no_other_is() {
        let (arm, intel) = (library("aarch64-linux"), library("linux64"));
        assert_eq!(arm.folders(std::slice::from_ref(&arm)), ["aarch64-linux", "linux64"]);
        assert_eq!(arm.folders(&[intel.clone(), arm.clone()]), ["aarch64-linux"]);
        assert_eq!(intel.folders(&[intel.clone(), arm]), ["linux64"]);
        assert_eq!(library("aarch64-darwin").folders(&[intel]), ["aarch64-darwin", "darwin64"]);
    }

    #[test]
    fn the_header_of_a_file_names_its_platform() {
        let mut elf = b"\x7fELF\x02\x01".to_vec();
        elf.resize(64, 0);
        elf[18] = 183;
        assert_eq!(target(&elf), Some(("linux", "aarch64")));
        elf[4] = 1;
        assert_eq!(target(&elf), None, "32 bits");
        let mut pe = b"MZ".to_vec();
        pe.resize(0x80, 0);
        pe[0x3c] = 0x40;
        pe[0x40..0x46].copy_from_slice(b"PE\0\0\x64\x86");
        assert_eq!(target(&pe), Some(("windows", "x86_64")));
        assert_eq!(target(&[0xcf, 0xfa, 0xed, 0xfe, 0x0c, 0, 0, 1]), Some(("macos", "aarch64")));
        for broken in [&b""[..], b"MZ not really", b"\x7fELF", &[0xff; 70]] {
            assert_eq!(target(broken), None);
        }
    }
}
