//! Text of a report: escaping for HTML and SVG, and numbers as a reader expects them.

/// Shown where a value is missing.
pub(crate) const MISSING: &str = "—";

/// Above this a fixed-point number is unreadable; powers of ten are written instead.
const FIXED_LIMIT: f64 = 1e9;

/// Escapes text for HTML and SVG content and double-quoted attributes.
///
/// Control characters that XML 1.0 forbids become the replacement character, so the page stays well formed.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\t' | '\n' | '\r' => out.push(character),
            c if (c as u32) < 0x20 || matches!(c as u32, 0xFFFE | 0xFFFF) => out.push('\u{FFFD}'),
            c => out.push(c),
        }
    }
    out
}

/// A number with a fixed count of decimals, a true minus sign and no negative zero.
pub(crate) fn fixed(value: f64, decimals: u8) -> String {
    let decimals = usize::from(decimals);
    let text = if value.abs() >= FIXED_LIMIT { scientific(value) } else { format!("{value:.decimals$}") };
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|b| matches!(b, b'0' | b'.')) => rest.to_owned(),
        Some(rest) => format!("−{rest}"),
        None => text,
    }
}

/// A number with `digits` significant digits, for tooltips and bar ends.
pub(crate) fn significant(value: f64, digits: i32) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let magnitude = magnitude(value, digits);
    if (-5..9).contains(&magnitude) {
        fixed(value, (digits - 1 - magnitude).clamp(0, 12) as u8)
    } else {
        scientific(value).replacen('-', "−", usize::from(value < 0.0))
    }
}

/// Decade of the first digit once a value other than 0 is rounded to `digits` significant ones: 9.996 with three is 10.0.
fn magnitude(value: f64, digits: i32) -> i32 {
    let mantissa_decimals = usize::try_from(digits - 1).unwrap_or(0);
    let text = format!("{:.mantissa_decimals$e}", value.abs());
    text.split_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or(0)
}

/// Decimals that show a value with `digits` significant digits; a zero has none.
pub(crate) fn decimals(value: f64, digits: i32) -> u8 {
    if value == 0.0 || !value.is_finite() { 0 } else { (digits - 1 - magnitude(value, digits)).clamp(0, 9) as u8 }
}

/// A whole number with thin spaces between groups of three digits from 10 000 on.
pub(crate) fn integer(value: i64) -> String {
    let digits = value.unsigned_abs().to_string();
    let sign = if value < 0 { "−" } else { "" };
    if digits.len() < 5 {
        return format!("{sign}{digits}");
    }
    let mut out = String::from(sign);
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            out.push('\u{202F}');
        }
        out.push(digit);
    }
    out
}

/// `1.23×10⁴`: mantissa with two decimals.
fn scientific(value: f64) -> String {
    let text = format!("{value:.2e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    format!("{mantissa}×10{}", superscript(exponent))
}

/// An exponent in superscript characters.
pub(crate) fn superscript(exponent: &str) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    exponent
        .chars()
        .filter_map(|c| match c {
            '-' => Some('⁻'),
            c => c.to_digit(10).and_then(|d| DIGITS.get(d as usize).copied()),
        })
        .collect()
}

/// Marks that may stand around a number.
const CLOSING: [char; 5] = ['.', ',', ';', ':', ')'];
/// Below this power of ten a probability is told by the power alone.
const TOLD_BY_POWER: i32 = -4;

/// A sentence that a terminal shows as well, as a page writes it. Words, units and signs are the same on both; numbers of a terminal
/// are those that programs read, and have a true minus sign and powers of ten with raised exponents here.
pub(crate) fn prose(text: &str) -> String {
    let mut words: Vec<String> = Vec::new();
    for word in text.split(' ') {
        let (open, core, rest) = parts(word);
        if let (Some(bound), [.., p, equals]) = (bound(core), words.as_mut_slice())
            && p.ends_with('p')
            && equals == "="
        {
            *equals = "<".to_owned();
            words.push(format!("{bound}{rest}"));
            continue;
        }
        words.push(format!("{open}{}{rest}", page_word(core)));
    }
    words.join(" ")
}

/// What opens a word, the word, and the marks after it.
fn parts(word: &str) -> (&str, &str, &str) {
    let inside = word.trim_start_matches('(');
    let core = inside.trim_end_matches(CLOSING);
    (&word[..word.len() - inside.len()], core, &inside[core.len()..])
}

fn page_word(core: &str) -> String {
    let is_number = |digits: &str| !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit() || b == b'.');
    match core.strip_prefix('-').filter(|digits| is_number(digits)) {
        Some(digits) => format!("−{digits}"),
        None => power(core).unwrap_or_else(|| core.to_owned()),
    }
}

/// Mantissa and exponent of a number such as `7.1e-42`.
fn exponential(core: &str) -> Option<(&str, i32)> {
    let (mantissa, exponent) = core.split_once('e')?;
    let digits = mantissa.strip_prefix('-').unwrap_or(mantissa);
    let is_number = digits.starts_with(|c: char| c.is_ascii_digit()) && digits.parse::<f64>().is_ok();
    Some((mantissa, exponent.parse().ok().filter(|_| is_number)?))
}

/// `7.1e-42` as 7.1×10⁻⁴², `1e-300` as 10⁻³⁰⁰, and what needs no power without one.
fn power(core: &str) -> Option<String> {
    let (mantissa, exponent) = exponential(core)?;
    if (-3..4).contains(&exponent) {
        let digits = mantissa.bytes().filter(u8::is_ascii_digit).count();
        return Some(significant(core.parse().ok()?, i32::try_from(digits).ok()?));
    }
    let ten = format!("10{}", superscript(&exponent.to_string()));
    match mantissa.strip_prefix('-') {
        _ if mantissa == "1" => Some(ten),
        Some(digits) => Some(format!("−{digits}×{ten}")),
        None => Some(format!("{mantissa}×{ten}")),
    }
}

/// The power of ten that a very small positive number is below.
fn bound(core: &str) -> Option<String> {
    let (mantissa, exponent) = exponential(core)?;
    let is_small = exponent <= TOLD_BY_POWER && !mantissa.starts_with('-');
    is_small.then(|| format!("10{}", superscript(&(exponent + 1).to_string())))
}

/// A text whose first letter is a capital. The sign of a quantity, as χ or µ, is another sign as a capital and stays.
pub(crate) fn capital(text: &str) -> String {
    let mut characters = text.chars();
    match characters.next() {
        Some(first) => std::iter::once(first.to_ascii_uppercase()).chain(characters).collect(),
        None => String::new(),
    }
}

/// Label with its unit: `position x / mm` as ISO 80000-1 writes it; the label alone for a pure number.
pub(crate) fn with_unit(label: &str, unit: &str) -> String {
    if matches!(unit, "" | "1") { label.to_owned() } else { format!("{label} / {unit}") }
}

/// The first few, and how many more there are.
pub(crate) fn listed(names: &[impl AsRef<str>], most: usize, separator: &str) -> String {
    let shown: Vec<&str> = names.iter().take(most).map(AsRef::as_ref).collect();
    let more = names.len() - shown.len();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{}{more}", shown.join(separator))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_is_escaped() {
        assert_eq!(escape("<script a=\"b\">'&\u{1}"), "&lt;script a=&quot;b&quot;&gt;&#39;&amp;\u{FFFD}");
    }

    #[test]
    fn what_a_terminal_shows_reads_on_a_page_as_written_by_hand() {
        assert_eq!(
            prose("-3.5 ± 0.2 µm, within 0.5 + L/400 µm: -4 µrad/m."),
            "−3.5 ± 0.2 µm, within 0.5 + L/400 µm: −4 µrad/m."
        );
        // Names of columns, options and files are no numbers.
        assert_eq!(prose("u_x_um --offset-mm 0,0,-60 - x-1 -a"), "u_x_um --offset-mm 0,0,-60 - x-1 -a");
    }

    /// "1e-32" is what programs write.
    #[test]
    fn regress_exponents_read_as_powers() {
        assert_eq!(prose("lost (5.10); p below 1e-300."), "lost (5.10); p below 10⁻³⁰⁰.");
        assert_eq!(
            prose("at p = 7.1e-42: 2.5e-7 µm → 9.5e-1, (-3.0e12)"),
            "at p < 10⁻⁴¹: 2.5×10⁻⁷ µm → 0.95, (−3.0×10¹²)"
        );
        assert_eq!(prose("p = 3.4e-3 by 1e, e-5, x1e5 and v1.0e"), "p = 0.0034 by 1e, e-5, x1e5 and v1.0e");
        assert_eq!(
            (capital("χ² left"), capital("3-D"), capital("largest")),
            ("χ² left".into(), "3-D".into(), "Largest".into())
        );
    }

    #[test]
    fn numbers_read_as_expected() {
        assert_eq!(fixed(-0.0004, 2), "0.00");
        assert_eq!(fixed(-1.25, 1), "−1.2");
        assert_eq!(fixed(-2.5e12, 1), "−2.50×10¹²");
        assert_eq!(significant(0.012345, 3), "0.0123");
        assert_eq!(significant(-1.5e-9, 3), "−1.50×10⁻⁹");
        assert_eq!(significant(9.996, 3), "10.0");
        assert_eq!(integer(1234), "1234");
        assert_eq!(integer(-1234567), "−1\u{202F}234\u{202F}567");
    }
}
