//! No update can panic, proved by the linker: `tools/no-panic/check.sh` says how.

use std::path::Path;
use std::process::Command;

#[test]
#[cfg_attr(not(unix), ignore = "a shell script")]
fn a_release_build_of_the_ticks_holds_no_panic() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tools/no-panic/check.sh");
    assert!(script.exists(), "{} is missing", script.display());
    let mut command = Command::new("sh");
    command.arg(script);
    // the flags of the tests are not those of a target
    for name in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET"] {
        command.env_remove(name);
    }
    let output = command.output().expect("sh");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    println!("{said}");
}
