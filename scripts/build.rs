//! Tells the program whether it is a test build, which does not measure itself: optimised less than the program that users have, or
//! with the profile `quick`, whose units of code are optimised each by itself.

use std::env::var;
use std::path::Path;

fn main() {
    println!("cargo:rerun-if-changed=scripts/build.rs");
    // target/PROFILE/build/greenstage-HASH/out
    let out = var("OUT_DIR").unwrap_or_default();
    let profile = Path::new(&out).ancestors().nth(3).and_then(Path::file_name);
    let is_less = var("OPT_LEVEL").is_ok_and(|level| level != "3");
    let is_test_build = is_less || profile.is_some_and(|profile| profile == "quick");
    println!("cargo:rustc-env=GREENSTAGE_TEST_BUILD={}", if is_test_build { "yes" } else { "no" });
}
