//! Tells the program how it was optimised, so that a test build does not measure itself.

fn main() {
    println!("cargo:rerun-if-changed=scripts/build.rs");
    println!("cargo:rustc-env=GREENSTAGE_OPT_LEVEL={}", std::env::var("OPT_LEVEL").unwrap_or_default());
}
