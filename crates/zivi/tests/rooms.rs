//! The rooms of the library know each other one way only.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Each room with the rooms whose names may stand in its files.
const ROOMS: [(&str, &[&str]); 14] = [
    ("numeric", &[]),
    ("record", &["numeric"]),
    ("system", &["numeric", "record"]),
    ("stepping", &["numeric", "record", "system"]),
    ("zeno", &["numeric", "record"]),
    ("piecewise", &["numeric", "record", "system"]),
    ("switched", &["numeric", "record", "system", "zeno", "piecewise"]),
    ("kinetics", &["numeric", "record", "system", "zeno"]),
    ("friction", &["numeric", "record", "system", "zeno", "kinetics"]),
    (
        "motion",
        &["numeric", "record", "system", "zeno", "piecewise", "switched", "kinetics", "friction"],
    ),
    (
        "impact",
        &["numeric", "record", "system", "zeno", "switched", "kinetics", "friction", "motion"],
    ),
    (
        "mechanics",
        &[
            "numeric",
            "record",
            "system",
            "zeno",
            "piecewise",
            "stepping",
            "switched",
            "kinetics",
            "friction",
            "motion",
            "impact",
        ],
    ),
    ("method", &["numeric", "record", "system", "stepping", "switched", "mechanics"]),
    (
        "drive",
        &[
            "numeric",
            "record",
            "system",
            "zeno",
            "piecewise",
            "stepping",
            "switched",
            "mechanics",
            "method",
        ],
    ),
];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// The code of a file, without comments and tests.
fn code(file: &Path) -> String {
    let text = fs::read_to_string(file).unwrap();
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

/// The names between the braces, or the one, that follow a path.
fn names(after: &str) -> Vec<String> {
    let list = match after.strip_prefix('{') {
        Some(rest) => rest.split('}').next().unwrap_or_default(),
        None => {
            after.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().unwrap_or_default()
        }
    };
    let first = |name: &str| name.trim().split("::").next().unwrap_or_default().to_string();
    list.split(',').map(first).filter(|name| !name.is_empty()).collect()
}

/// Of which room the names are that the library gives at its root.
fn at_the_root(src: &Path) -> HashMap<String, String> {
    let lib = code(&src.join("lib.rs"));
    let mut rooms = HashMap::new();
    for line in lib.split("pub use ").skip(1) {
        let line = line.split(';').next().unwrap_or_default();
        let (path, given) = match line.find('{') {
            Some(brace) => line.split_at(brace),
            None => line.split_at(line.rfind("::").map_or(0, |at| at + 2)),
        };
        let room = path.split("::").next().unwrap_or_default().to_string();
        rooms.extend(names(given).into_iter().map(|name| (name, room.clone())));
    }
    rooms
}

#[test]
fn a_room_knows_only_what_it_may() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let root = at_the_root(&src);
    assert!(root["Force"] == "system" && root["SwitchedRk"] == "switched", "{root:?}");
    let mut wrong = Vec::new();
    for (room, known) in ROOMS {
        let mut files = Vec::new();
        sources(&src.join(room), &mut files);
        assert!(!files.is_empty(), "no file in {room}");
        for file in files {
            for after in code(&file).split("crate::").skip(1) {
                for name in names(after) {
                    let of = root.get(&name).unwrap_or(&name);
                    let is_room = ROOMS.iter().any(|it| it.0 == of);
                    if is_room && of != room && !known.contains(&of.as_str()) {
                        wrong.push(format!("{} names {name} of {of}", file.display()));
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
