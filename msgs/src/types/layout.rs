//! Test support: describes the memory layout of the samples and holds the hash of it that stands
//! in their shared-memory names.
//!
//! Place in the flow: tests only. The description lists every field with its name, offset and type,
//! down to the numbers, so that adding, renaming, reordering or resizing anything changes the hash.

use iceoryx2::prelude::ZeroCopySend;

use super::*;

/// Describes the layout of a type, recursively.
trait Layout {
    fn describe() -> String;
}

macro_rules! number_layout {
    ($($number:ident),*) => {$(
        impl Layout for $number {
            fn describe() -> String {
                stringify!($number).to_owned()
            }
        }
    )*};
}
number_layout!(bool, u8, u32, i32, u64, f64);

impl<T: Layout, const N: usize> Layout for [T; N] {
    fn describe() -> String {
        format!("[{};{N}]", T::describe())
    }
}

fn describe_value<T: Layout>(_: &T) -> String {
    T::describe()
}

// The pattern without `..` makes a field that is missing here a compile error.
macro_rules! struct_layout {
    ([$($generics:tt)*] $name:ident $(<$arg:ident>)?, $sample:expr, { $($field:ident),* $(,)? }) => {
        impl<$($generics)*> Layout for $name $(<$arg>)? {
            fn describe() -> String {
                let $name { $($field),* } = &$sample;
                let mut fields = String::new();
                $(fields += &format!(
                    "{}@{}:{};",
                    stringify!($field),
                    std::mem::offset_of!(Self, $field),
                    describe_value($field),
                );)*
                format!("{}({}){{{fields}}}", stringify!($name), size_of::<Self>())
            }
        }
    };
}

macro_rules! enum_layout {
    ($($name:ident),*) => {$(
        impl Layout for $name {
            fn describe() -> String {
                let names: Vec<_> = $name::ALL.iter().map(|s| (*s as u8, s.name())).collect();
                format!("{}({}){names:?}", stringify!($name), size_of::<Self>())
            }
        }
    )*};
}
enum_layout!(CorrectionStatus, ResidualStatus);

// Opaque fields of the small types are private to their files, so size and name stand for them.
impl Layout for Stamp {
    fn describe() -> String {
        format!("Stamp({})sec:i32,nanosec:u32", size_of::<Self>())
    }
}
impl Layout for Sha256 {
    fn describe() -> String {
        format!("Sha256({})", size_of::<Self>())
    }
}
impl<const N: usize> Layout for Text<N> {
    fn describe() -> String {
        format!("Text({})bytes:[u8;{N}],length:u8", size_of::<Self>())
    }
}
impl Layout for Covariates {
    fn describe() -> String {
        let entry = Covariate::describe();
        format!("Covariates({})entries:[{entry};{COVARIATE_CAPACITY}],count:u32", size_of::<Self>())
    }
}

struct_layout!([] Covariate, Covariate::default(), { name, value, age_s });
struct_layout!([] ScaleReading, ScaleReading::default(), {
    stamp, sequence, reading_m, offset_m, covariates, frame_id,
});
struct_layout!([] TracerReading, TracerReading::default(), {
    stamp, sequence, length_m, u_length_m, frame_id, station, line,
});
struct_layout!([] CorrectedCoordinates, crate::test_samples::corrected(), {
    stamp, sequence, reading_m, offset_m, geometric_correction_m, effect_correction_m,
    residual_correction_m, corrected_m, covariance_m2, model_sha256, residual_model_sha256,
    frame_id, corrected_valid, status,
});
struct_layout!([] RangeResidual, crate::test_samples::residual(), {
    stamp, sequence, measured_length_m, predicted_length_m, residual_m, u_residual_m,
    model_sha256, frame_id, station, residual_valid, status,
});

#[allow(unsafe_code)] // type_name() only returns the name; its contract is the layout tested here.
fn assert_name_carries_layout<T: Layout + ZeroCopySend>(message: &str) {
    let digest = Sha256::of(T::describe().as_bytes()).to_hex();
    let expected = format!("abbe/{message}/{}", &digest[..8]);
    let name = unsafe { <T as ZeroCopySend>::type_name() };
    assert_eq!(name, expected, "the layout is now {}; write its hash into #[type_name(...)]", T::describe());
}

#[test]
fn shared_memory_names_carry_the_hash_of_the_layout() {
    assert_name_carries_layout::<ScaleReading>("ScaleReading");
    assert_name_carries_layout::<TracerReading>("TracerReading");
    assert_name_carries_layout::<CorrectedCoordinates>("CorrectedCoordinates");
    assert_name_carries_layout::<RangeResidual>("RangeResidual");
}
