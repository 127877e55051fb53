//! Text inside HTML and SVG: escaped, shortened, and its width.

/// Text as the content of an element or of a quoted attribute. Characters that XML does not know become �.
pub fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            '\t' | '\n' | '\r' => safe.push(' '),
            '\u{0}'..='\u{1f}' | '\u{7f}'..='\u{9f}' | '\u{fffe}' | '\u{ffff}' => safe.push('\u{fffd}'),
            // A text that runs from right to left must not turn the figures beside it.
            '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => {
                safe.push('\u{fffd}');
            }
            c => safe.push(c),
        }
    }
    safe
}

/// Shortens a text to `most` characters, the last of which is then an ellipsis.
pub fn shortened(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        None => text.to_owned(),
        Some(_) => text.chars().take(most.saturating_sub(1)).chain(['…']).collect(),
    }
}

/// Width of `text` in pixels at font size `size`, no less than common sans serif fonts need.
pub fn width(text: &str, size: f64) -> f64 {
    let share = |c: char| match c {
        'i' | 'j' | 'l' | '.' | ',' | '\'' | '|' | ':' | ';' | '!' | '·' | ' ' => 0.33,
        'c' | 's' | 'k' | 'v' | 'x' | 'y' | 'z' => 0.59,
        'f' | 't' | 'r' | '(' | ')' | '/' | '-' | '⁻' | '¹' => 0.41,
        '⁰' | '²'..='³' | '⁴'..='⁹' => 0.42,
        'm' | 'w' | 'M' | 'W' | '%' | '@' | '—' | '…' => 0.97,
        'A'..='Z' => 0.72,
        '\0'..='\u{24f}' => 0.63,
        'Ͱ'..='ӿ' => 0.75,
        _ => 1.0,
    };
    size * text.chars().map(share).sum::<f64>()
}
