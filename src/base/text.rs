//! Makes text from files, devices and other machines safe to show: it cannot move a terminal's cursor, change its colours, or
//! reverse the words near it.
//!
//! In: any text. Out: the same with control characters and marks of direction written as JSON writes them (`\u001b`), so
//! that JSON stays JSON; what is left may also stand in XML 1.0.

use std::fmt::Display;

/// Makes a text of several lines safe to show; line ends and tabs stay.
pub fn plain(text: impl Display) -> String {
    let text = text.to_string();
    if text.chars().all(|c| is_shown(c) || c == '\n' || c == '\t') {
        return text;
    }
    let lines = text.split('\n').map(|line| {
        let (line, end) = line.strip_suffix('\r').map_or((line, ""), |line| (line, "\r"));
        line.split('\t').map(one_line).collect::<Vec<_>>().join("\t") + end
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Makes a name safe to show, on one line whatever it holds.
pub fn one_line(text: impl Display) -> String {
    let mut shown = String::new();
    for c in text.to_string().chars() {
        match c {
            c if is_shown(c) => shown.push(c),
            '\n' => shown.push_str("\\n"),
            '\r' => shown.push_str("\\r"),
            '\t' => shown.push_str("\\t"),
            c => shown.push_str(&format!("\\u{:04x}", u32::from(c))),
        }
    }
    shown
}

/// Quotes an argument for a shell.
pub fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./=,:+@".contains(c);
    match !word.is_empty() && word.chars().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

/// Whether the character is only itself: no control character, none that ends a line, none that sets the direction of
/// writing (Unicode Standard Annex 9), and one of XML 1.0 (section 2.2).
fn is_shown(c: char) -> bool {
    let turns = matches!(
        c,
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
    );
    let ends = matches!(c, '\u{2028}' | '\u{2029}');
    !(c.is_control() || turns || ends || matches!(c, '\u{fffe}' | '\u{ffff}'))
}

/// Bytes as text: RFC 4648, base 64, with padding.
pub fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let byte = |i: usize| u32::from(three.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            let place = (bits >> (18 - 6 * digit)) as usize & 63;
            text.push(if digit <= three.len() { char::from(DIGITS[place]) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_steers_a_terminal_is_shown_instead() {
        assert_eq!(one_line("\u{1b}[2Jevil"), "\\u001b[2Jevil");
        assert_eq!(one_line("a\u{9b}31m\u{7f}b\u{202e}c\u{2066}d"), "a\\u009b31m\\u007fb\\u202ec\\u2066d");
        assert_eq!(one_line("a\r\nerror: b\t"), "a\\r\\nerror: b\\t");
        assert_eq!(one_line("röhre 30° – 管 \\"), "röhre 30° – 管 \\");
    }

    #[test]
    fn lines_and_tabs_stay() {
        assert_eq!(plain("a\tb\n\u{1b}c\r\n\rd\n"), "a\tb\n\\u001bc\r\n\\rd\n");
        assert_eq!(plain("step  time\n──────\n"), "step  time\n──────\n");
    }

    #[test]
    fn json_stays_json() {
        let value = serde_json::json!({ "name": "\u{1b}[2J\u{7f}\u{202e}\n\"" });
        let shown = plain(format!("{value:#}"));
        assert!(!shown.contains(['\u{1b}', '\u{7f}', '\u{202e}']));
        assert_eq!(serde_json::from_str::<serde_json::Value>(&shown).unwrap(), value);
    }

    #[test]
    fn base64_is_that_of_rfc_4648() {
        let known = ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"];
        assert_eq!([0, 1, 2, 3, 4, 5, 6].map(|length| base64(&b"foobar"[..length])), known);
        assert_eq!(base64(&[0xfb, 0xef, 0xff]), "++//");
    }
}
