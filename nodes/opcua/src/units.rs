//! Units as servers name them: the property `EngineeringUnits` of a variable, with the common codes of UNECE Recommendation 20.
//!
//! Place in the flow: the client reads the property when a session begins; what a value means is decided here, once. OPC 10000-8,
//! 5.6.3: where the namespace is that of UNECE, the identifier of the unit is its common code, the characters of which are the
//! bytes of a number: `MMT`, millimetre, is 0x4D4D54.

/// Namespace of the identifiers that are common codes.
pub const UNECE: &str = "http://www.opcfoundation.org/UA/units/un/cefact";

/// Common codes, and the unit at the end of a name that means the same.
const CODES: [(&str, &str); 32] = [
    ("MMT", "_mm"),
    ("4H", "_um"),
    ("C45", "_nm"),
    ("MTR", "_m"),
    ("CMT", "_cm"),
    ("INH", "_in"),
    ("CEL", "_c"),
    ("KEL", "_k"),
    ("FAH", "_f"),
    ("A97", "_hpa"),
    ("MBR", "_mbar"),
    ("PAL", "_pa"),
    ("KPA", "_kpa"),
    ("BAR", "_bar"),
    ("P1", "_pct"),
    ("KGM", "_kg"),
    ("GRM", "_g"),
    ("C16", "_mm_s"),
    ("MTS", "_m_s"),
    ("H81", "_mm_min"),
    ("2X", "_m_min"),
    ("M41", "_mm_s2"),
    ("MSK", "_m_s2"),
    ("SEC", "_s"),
    ("C26", "_ms"),
    ("MIN", "_min"),
    ("HUR", "_h"),
    ("NEW", "_n"),
    ("DD", "_deg"),
    ("AMP", "_a"),
    ("VLT", "_v"),
    ("C62", "_1"),
];

/// Units of length, and one of each in metres.
const LENGTHS: [(&str, f64); 6] =
    [("_mm", 1e-3), ("_um", 1e-6), ("_nm", 1e-9), ("_m", 1.0), ("_cm", 1e-2), ("_in", 0.0254)];

/// A unit as a server names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerUnit {
    /// Namespace of the identifier.
    pub namespace: String,
    /// The identifier.
    pub id: i32,
    /// What it is shown as.
    pub shown: String,
}

impl ServerUnit {
    /// The unit as it stands at the end of a name; `None` of one that is not known.
    pub fn suffix(&self) -> Option<&'static str> {
        let found = CODES.iter().find(|(code, _)| self.namespace == UNECE && identifier(code) == self.id);
        found.map(|(_, suffix)| *suffix)
    }

    /// The unit in words, for messages.
    pub fn words(&self) -> String {
        format!("{:?} (identifier {} of {:?})", self.shown, self.id, self.namespace)
    }
}

/// The identifier of a common code.
fn identifier(code: &str) -> i32 {
    code.bytes().fold(0, |number, byte| (number << 8) | i32::from(byte))
}

/// The identifier of a unit as it stands at the end of a name; `None` of one that is not known.
pub(crate) fn identifier_of(suffix: &str) -> Option<i32> {
    CODES.iter().find(|(_, known)| *known == suffix).map(|(code, _)| identifier(code))
}

/// One of this unit in metres; `None` of what is no length.
pub fn metres_in(suffix: &str) -> Option<f64> {
    LENGTHS.iter().find(|(unit, _)| *unit == suffix).map(|(_, metres)| *metres)
}

/// The unit of length at the end of a name, with what stands before it.
pub fn length_of(name: &str) -> (&str, Option<&'static str>) {
    let named = LENGTHS.iter().find_map(|(unit, _)| Some((name.strip_suffix(unit)?, *unit)));
    named.map_or((name, None), |(stem, unit)| (stem, Some(unit)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Identifiers as the table of the OPC Foundation has them (UNECE_to_OPCUA.csv).
    #[test]
    fn val_unece_to_opcua_identifiers() {
        for (code, id) in [
            ("MMT", 5_066_068),
            ("4H", 13_384),
            ("MTR", 5_067_858),
            ("INH", 4_804_168),
            ("CEL", 4_408_652),
            ("KEL", 4_932_940),
            ("FAH", 4_604_232),
            ("PAL", 5_259_596),
            ("C16", 4_403_510),
            ("P1", 20_529),
            ("DD", 17_476),
        ] {
            assert_eq!(identifier(code), id, "{code}");
        }
    }

    #[test]
    fn a_unit_is_known_by_its_code_in_its_namespace_alone() {
        let unit = |namespace: &str, id| ServerUnit { namespace: namespace.to_owned(), id, shown: "mm".to_owned() };
        assert_eq!(unit(UNECE, 5_066_068).suffix(), Some("_mm"));
        assert_eq!(unit("http://maker.example/units", 5_066_068).suffix(), None, "what it is shown as proves nothing");
        assert_eq!(unit(UNECE, 0).suffix(), None);
    }

    #[test]
    fn lengths_are_told_from_what_is_none() {
        assert_eq!(length_of("x_um"), ("x", Some("_um")));
        assert_eq!(length_of("x"), ("x", None));
        assert_eq!(metres_in("_in"), Some(0.0254));
        assert_eq!(metres_in("_c"), None);
    }
}
