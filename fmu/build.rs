//! Lists the pictures of the models, `assets/pictures/<model>.png`, for `pack` to look up by the model's name.

use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = Path::new(&std::env::var("CARGO_MANIFEST_DIR")?).join("assets/pictures");
    println!("cargo::rerun-if-changed={}", folder.display());
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&folder)? {
        let path = entry?.path();
        if let Some(name) = path.file_stem().and_then(|name| name.to_str())
            && path.extension().is_some_and(|ending| ending == "png")
        {
            names.push(name.to_owned());
        }
    }
    names.sort();
    let line = |name: &String| format!("({name:?}, include_bytes!({:?})),\n", folder.join(format!("{name}.png")));
    let list: String = names.iter().map(line).collect();
    std::fs::write(Path::new(&std::env::var("OUT_DIR")?).join("pictures.rs"), format!("&[\n{list}]\n"))?;
    Ok(())
}
