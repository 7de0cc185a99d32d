//! The rooms of the library know each other one way only.

use std::fs;
use std::path::{Path, PathBuf};

/// Each room with the rooms whose names may stand in its files.
const ROOMS: [(&str, &[&str]); 2] = [("numeric", &[]), ("system", &["numeric", "record"])];

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

#[test]
fn a_room_knows_only_what_it_may() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for (room, known) in ROOMS {
        let mut files = Vec::new();
        sources(&src.join(room), &mut files);
        assert!(!files.is_empty(), "no file in {room}");
        for file in files {
            let text = fs::read_to_string(&file).unwrap();
            for other in
                ["numeric", "system", "record", "stepping", "switched", "mechanics", "drive"]
            {
                let may = other == room || known.contains(&other);
                assert!(
                    may || !text.contains(&format!("crate::{other}::")),
                    "{} names the room {other}",
                    file.display()
                );
            }
        }
    }
}
