//! Tells the library from what text it is compiled, and where. So an installed program finds the library
//! that it was linked from, as long as the folder is there, and takes no other for it.

use std::fs;
use std::hash::{DefaultHasher, Hasher as _};
use std::path::{Path, PathBuf};

/// What is compiled.
const FOLDERS: [&str; 5] = ["src", "engine/src", "language/src", "macros/src", "assets"];

fn main() {
    let root = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let mut hasher = DefaultHasher::new();
    for folder in FOLDERS {
        println!("cargo:rerun-if-changed={folder}");
        hash(&root.join(folder), &root, &mut hasher);
    }
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-env=EPLAT_TEXT={:016x}", hasher.finish());
    // …/release/build/eplat-HASH/out
    let out = PathBuf::from(std::env::var_os("OUT_DIR").unwrap_or_default());
    let libraries = out.ancestors().nth(3).unwrap_or(&out).join("deps");
    println!("cargo:rustc-env=EPLAT_LIBRARIES={}", libraries.display());
}

/// Adds the names and contents of the files in a folder, in the order of their names.
fn hash(folder: &Path, root: &Path, hasher: &mut DefaultHasher) {
    let mut paths: Vec<PathBuf> =
        fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            hash(&path, root, hasher);
        } else {
            let name = path.strip_prefix(root).unwrap_or(&path);
            hasher.write(name.as_os_str().as_encoded_bytes());
            hasher.write(&fs::read(&path).unwrap_or_default());
        }
    }
}
