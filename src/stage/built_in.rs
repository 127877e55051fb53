//! The built-in stages.

use super::error::StageError;
use crate::config;
use std::borrow::Cow;
use std::path::PathBuf;

/// The files of the built-in stages, by name.
pub const BUILT_IN: [(&str, &str); 11] = [
    ("workbench", include_str!("../../configs/stages/workbench.toml")),
    ("workbench-one-sided", include_str!("../../configs/stages/workbench-one-sided.toml")),
    ("cyberstage", include_str!("../../configs/stages/cyberstage.toml")),
    ("desktop", include_str!("../../configs/stages/desktop.toml")),
    ("lbench", include_str!("../../configs/stages/lbench.toml")),
    ("cave3", include_str!("../../configs/stages/cave3.toml")),
    ("cave6", include_str!("../../configs/stages/cave6.toml")),
    ("powerwall", include_str!("../../configs/stages/powerwall.toml")),
    ("laptop", include_str!("../../configs/stages/laptop.toml")),
    ("demo", include_str!("../../configs/stages/demo.toml")),
    ("workbench-in-a-window", include_str!("../../configs/stages/workbench-in-a-window.toml")),
];

/// The text of a built-in stage or of a file, and the path that errors name.
pub fn text_of(name_or_path: &str) -> Result<(Cow<'static, str>, PathBuf), StageError> {
    if name_or_path.ends_with(".toml") {
        let path = PathBuf::from(name_or_path);
        return Ok((config::read(&path)?.into(), path));
    }
    match BUILT_IN.iter().find(|(name, _)| *name == name_or_path) {
        Some((name, text)) => Ok(((*text).into(), format!("configs/stages/{name}.toml").into())),
        None => {
            let (name, names) = (name_or_path.to_owned(), BUILT_IN.map(|(name, _)| name));
            let known = names.map(|name| format!("`{name}`")).join(", ");
            Err(StageError::Unknown { nearest: config::nearest(&name, names), name, known })
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::stage::Stage;

    #[test]
    fn an_unknown_name_is_answered_with_the_nearest() {
        let text = Stage::find("workbensh").unwrap_err().to_string();
        assert!(text.contains("did you mean `workbench`?") && text.contains("cyberstage"), "{text}");
        assert!(Stage::find("no/such.toml").unwrap_err().to_string().starts_with("no/such.toml: "));
    }
}
