//! The committed header is what the sources say.
#![allow(clippy::unwrap_used)]

use std::path::Path;

/// With this in the environment, the header is written instead of compared.
const WRITE: &str = "UVCAM_WRITE_HEADER";

#[test]
fn the_header_is_the_one_that_the_sources_give() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut header = Vec::new();
    let config = cbindgen::Config::from_file(package.join("cbindgen.toml")).unwrap();
    let builder = cbindgen::Builder::new().with_config(config).with_crate(package);
    builder.generate().unwrap().write(&mut header);
    let file = package.join("include/uvcam.h");
    let header = without_safety(&String::from_utf8(header).unwrap());
    if std::env::var_os(WRITE).is_some() {
        std::fs::write(&file, &header).unwrap();
    }
    let committed = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(
        committed == header,
        "{} is not what the sources give: {WRITE}=1 cargo test -p uvcam-c --test header",
        file.display()
    );
}

/// The laws are for readers of the sources: the header opens with them in the words of C.
fn without_safety(header: &str) -> String {
    let mut in_safety = false;
    let lines = header.lines().filter(|line| {
        in_safety = (in_safety || line.trim() == "* # Safety") && line.trim() != "*/";
        !in_safety
    });
    lines.collect::<Vec<_>>().join("\n").replace("\n *\n */", "\n */") + "\n"
}
