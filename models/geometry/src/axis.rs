//! Axes and the ISO 230-1 names of the eighteen position-dependent errors.
//!
//! Place in the flow: every table of errors, coefficients and columns in Abbe is indexed by [`ErrorId`].

use nalgebra::Vector3;

/// A linear axis of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Axis {
    /// X
    X,
    /// Y
    Y,
    /// Z
    Z,
}

impl Axis {
    /// X, Y, Z.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// 0, 1, 2 for X, Y, Z.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// `'X'`, `'Y'` or `'Z'`.
    pub const fn letter(self) -> char {
        ['X', 'Y', 'Z'][self as usize]
    }

    /// `"x"`, `"y"` or `"z"`, as in file and covariate names.
    pub const fn lower(self) -> &'static str {
        ["x", "y", "z"][self as usize]
    }

    /// Letter of the rotation about this axis: A, B or C (ISO 841).
    pub const fn rotation_letter(self) -> char {
        ['A', 'B', 'C'][self as usize]
    }

    /// Axis named by that letter, upper case.
    pub fn from_letter(letter: char) -> Option<Axis> {
        Axis::ALL.into_iter().find(|axis| axis.letter() == letter)
    }

    /// Axis of that name, lower case.
    pub fn from_lower(name: &str) -> Option<Axis> {
        Axis::ALL.into_iter().find(|axis| axis.lower() == name)
    }

    /// Unit vector of the nominal axis direction in the machine frame.
    pub fn direction(self) -> Vector3<f64> {
        Vector3::ith(self.index(), 1.0)
    }
}

/// One of the 18 position-dependent errors, E⟨direction⟩⟨axis⟩ of ISO 230-1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ErrorId {
    axis: Axis,
    component: u8,
}

impl ErrorId {
    /// Number of position-dependent errors of three axes.
    pub const COUNT: usize = 18;

    /// All errors in the order of [`ErrorId::index`]: EXX EYX EZX EAX EBX ECX EXY …
    pub fn all() -> impl Iterator<Item = ErrorId> {
        Axis::ALL.into_iter().flat_map(|axis| (0..6).map(move |component| ErrorId { axis, component }))
    }

    /// Linear error of `axis` in `direction`, such as EYX.
    pub const fn linear(direction: Axis, axis: Axis) -> ErrorId {
        ErrorId { axis, component: direction as u8 }
    }

    /// Angular error of `axis` about `about`, such as EBX.
    pub const fn angular(about: Axis, axis: Axis) -> ErrorId {
        ErrorId { axis, component: 3 + about as u8 }
    }

    /// Error of that name, such as `EXX` or `EBZ`.
    pub fn from_name(name: &str) -> Option<ErrorId> {
        ErrorId::all().find(|id| id.name() == name)
    }

    /// ISO 230-1 name, such as `EXX` or `EBZ`.
    pub fn name(self) -> String {
        let directions = ['X', 'Y', 'Z', 'A', 'B', 'C'];
        format!("E{}{}", directions[self.component as usize], self.axis.letter())
    }

    /// Position in tables of eighteen: axis · 6 + (X Y Z A B C).
    pub const fn index(self) -> usize {
        self.axis as usize * 6 + self.component as usize
    }

    /// Axis whose position the error depends on.
    pub const fn axis(self) -> Axis {
        self.axis
    }

    /// True for the three rotations (rad), false for the three translations (m).
    pub const fn is_angular(self) -> bool {
        self.component >= 3
    }

    /// True for the two translations across the axis, whose slope the squareness carries.
    pub const fn is_straightness(self) -> bool {
        self.component < 3 && self.component != self.axis as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_indices_agree_with_iso_230_1() {
        let names: Vec<String> = ErrorId::all().map(ErrorId::name).collect();
        assert_eq!(names[..6], ["EXX", "EYX", "EZX", "EAX", "EBX", "ECX"]);
        assert_eq!(names[17], "ECZ");
        for (index, id) in ErrorId::all().enumerate() {
            assert_eq!(id.index(), index);
            assert_eq!(ErrorId::from_name(&id.name()), Some(id));
        }
        assert_eq!(ErrorId::linear(Axis::Y, Axis::X).name(), "EYX");
        assert_eq!(ErrorId::angular(Axis::Y, Axis::Z).name(), "EBZ");
        assert_eq!(ErrorId::all().filter(|id| id.is_straightness()).count(), 6);
    }
}
