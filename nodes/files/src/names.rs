//! Which known name a misspelt one was meant to be.
//!
//! Place in the flow: the readers of machine, campaign and point files put it into their messages.

use abbe_geometry::seen::TEMPERATURE;

/// The known name nearest to `name`, if it is near enough to be a slip of the pen: one letter in short names, two
/// in longer ones, case aside.
pub(crate) fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = name.to_lowercase();
    known
        .into_iter()
        .map(|candidate| (strsim::damerau_levenshtein(&lower, &candidate.to_lowercase()), candidate))
        .filter(|(distance, candidate)| *distance <= if candidate.len() < 6 { 1 } else { 2 })
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// What carries an offset.
const OFFSET_WORDS: [&str; 5] = ["offset", "offsets", "tip", "stylus", "reflector"];
const AXES: [&str; 3] = ["x", "y", "z"];
/// What has an axis and is no length: `temp_tip_z_c`, `stylus_force_z_n`.
const NO_LENGTHS: [&str; 8] = ["temp", "temperature", "force", "deg", "rad", "urad", "speed", "acc"];

/// Whether a column may hold the offset of tip or reflector along an axis, whatever it is called: `Offset X (mm)`, `tip_x_mm`, `OffsetX`.
pub(crate) fn is_like_offset(name: &str) -> bool {
    let words = words(name);
    let is_both = |word: &String| {
        let rest = |carrier: &str| word.strip_prefix(carrier).or_else(|| word.strip_suffix(carrier));
        OFFSET_WORDS.iter().filter_map(|carrier| rest(carrier)).any(|rest| AXES.contains(&rest))
    };
    let has = |known: &[&str]| words.iter().any(|word| known.contains(&word.as_str()));
    !has(&NO_LENGTHS) && (words.iter().any(is_both) || (has(&OFFSET_WORDS) && has(&AXES)))
}

/// Words of a temperature, whatever its unit.
const TEMPERATURE_WORDS: [&str; 7] = ["temp", "temperature", "celsius", "kelvin", "fahrenheit", "degc", "degf"];

/// Whether a column looks like a temperature whose name does not end as those in °C do: `Temperature`, `temp_air_f`, `T_X [degC]`.
pub(crate) fn is_like_temperature(name: &str) -> bool {
    let words = words(name);
    // `degC` is two words.
    let is_degrees = |pair: &[String]| pair[0] == "deg" && ["c", "f", "k"].contains(&pair[1].as_str());
    let has_unit = ["°C", "°F", "°K"].iter().any(|unit| name.contains(unit)) || words.windows(2).any(is_degrees);
    !name.ends_with(TEMPERATURE) && (has_unit || words.iter().any(|word| TEMPERATURE_WORDS.contains(&word.as_str())))
}

/// The words of a name, in small letters: `OffsetX [mm]` has three.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut was_small = false;
    for letter in name.chars() {
        if !letter.is_alphabetic() || (was_small && letter.is_uppercase()) {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut().filter(|_| letter.is_alphabetic()) {
            word.extend(letter.to_lowercase());
        }
        was_small = letter.is_lowercase();
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scale under such a name was held to expand by nothing: 27 µm at 6 K, within an uncertainty of 0.6.
    #[test]
    fn regress_temperatures_are_told_by_their_words() {
        for name in ["Temperature", "temp_scale_x_f", "temp_air_k", "T_X [degC]", "T (°C)", "AirTemp", "temp"] {
            assert!(is_like_temperature(name), "{name}");
        }
        for name in ["temp_air_c", "temp_air_lag_300s_c", "template_no", "attempt", "load_kg", "q2_deg", "C [°]", "k"]
        {
            assert!(!is_like_temperature(name), "{name}");
        }
    }

    #[test]
    fn offsets_are_told_by_their_words() {
        for name in [
            "offset_x [mm]",
            "Offset X (mm)",
            "OffsetX",
            "OFFSETZ",
            "x_offset",
            "XOffset",
            "tip_x_mm",
            "offset_x_inches",
            "Stylus.Z",
            "reflector_y",
        ] {
            assert!(is_like_offset(name), "{name}");
        }
        for name in [
            "tip_diameter_mm",
            "temp_tip_z_c",
            "stylus_force_z_n",
            "stylus",
            "offset",
            "multiplier_x",
            "temp_x_c",
            "description",
            "note",
            "x_mm",
            "tipping_z",
        ] {
            assert!(!is_like_offset(name), "{name}");
        }
    }
}
