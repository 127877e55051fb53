//! Tables for people (aligned columns, text left and numbers right), and the cells of comma-separated values (RFC 4180).

use super::text::one_line;

/// Rows of equal length; the first row is the heading. A cell is one line, whatever name it shows ([`one_line`]).
pub struct Table {
    pub rows: Vec<Vec<String>>,
}

impl Table {
    pub fn new(heading: &[&str]) -> Table {
        Table { rows: vec![heading.iter().map(one_line).collect()] }
    }

    pub fn row(&mut self, cells: &[&str]) {
        self.rows.push(cells.iter().map(one_line).collect());
    }

    /// Aligned text with a rule under the heading.
    pub fn text(&self) -> String {
        let widths = self.widths();
        let mut text = String::new();
        for (i, row) in self.rows.iter().enumerate() {
            let pad = |(c, (cell, &width)): (usize, (&String, &usize))| {
                if i > 0 && self.is_numeric(c) {
                    format!("{cell:>width$}")
                } else {
                    format!("{cell:<width$}")
                }
            };
            let cells: Vec<String> = row.iter().zip(&widths).enumerate().map(pad).collect();
            text.push_str(cells.join("  ").trim_end());
            text.push('\n');
            if i == 0 {
                text.push_str(&"─".repeat(widths.iter().sum::<usize>() + 2 * widths.len().saturating_sub(1)));
                text.push('\n');
            }
        }
        text
    }

    /// Formats the table as Markdown.
    pub fn markdown(&self) -> String {
        let mut text = String::new();
        for (i, row) in self.rows.iter().enumerate() {
            text.push_str(&format!("| {} |\n", row.join(" | ")));
            if i == 0 {
                text.push_str(&format!("|{}\n", "---|".repeat(row.len())));
            }
        }
        text
    }

    /// Whether every cell of a column begins like a number: such columns stand to the right.
    fn is_numeric(&self, column: usize) -> bool {
        let begins_like_one =
            |cell: &String| cell.is_empty() || cell.starts_with(|c: char| c.is_ascii_digit() || c == '-');
        self.rows[1..].iter().filter_map(|row| row.get(column)).all(begins_like_one)
    }

    fn widths(&self) -> Vec<usize> {
        let columns = self.rows.first().map_or(0, Vec::len);
        (0..columns)
            .map(|c| {
                self.rows
                    .iter()
                    .filter_map(|row| row.get(c))
                    .map(|cell| cell.chars().count())
                    .max()
                    .unwrap_or(0)
            })
            .collect()
    }
}

/// "1 error", "2 errors".
pub fn count(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// A time in the unit that suits it.
pub fn seconds(s: f64) -> String {
    if s >= 0.9995 {
        format!("{s:.2} s")
    } else if s >= 0.9995e-3 {
        format!("{:.2} ms", s * 1e3)
    } else {
        format!("{:.1} µs", s * 1e6)
    }
}

/// A duration in a suitable unit, without digits that nobody knows.
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{:.0} s", s.max(1.0)),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s if s < 2e5 => format!("{:.0} h", s / 3600.0),
        s => format!("{:.0} days", s / 86400.0),
    }
}

/// A number of bytes in the unit that suits it.
pub fn bytes(count: f64) -> String {
    match count {
        c if c >= 1e9 => format!("{:.2} GB", c * 1e-9),
        c if c >= 1e6 => format!("{:.2} MB", c * 1e-6),
        c if c >= 1e3 => format!("{:.1} kB", c * 1e-3),
        c => format!("{c:.0} B"),
    }
}

/// The cell as it is written: in quotes if it holds a comma, a quote or the end of a line.
pub fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\r', '\n']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_with_line_ends_and_escapes_stays_in_its_cell() {
        let mut table = Table::new(&["group", "nodes"]);
        table.row(&["\u{1b}[2J\nall", "7"]);
        assert_eq!(table.text().lines().nth(2), Some("\\u001b[2J\\nall      7"));
    }

    #[test]
    fn columns_align() {
        let mut table = Table::new(&["step", "time"]);
        table.row(&["assembly", "1.5 s"]);
        table.row(&["ordering", "12.5 s"]);
        assert_eq!(table.text(), "step      time\n────────────────\nassembly   1.5 s\nordering  12.5 s\n");
        assert_eq!(table.markdown().lines().nth(1), Some("|---|---|"));
    }

    #[test]
    fn cells_are_quoted_where_they_must_be() {
        assert_eq!(quoted("bend 30"), "bend 30");
        assert_eq!(quoted("a,b \"c\""), "\"a,b \"\"c\"\"\"");
        assert_eq!(quoted("two\r\nlines"), "\"two\r\nlines\"");
    }
}
