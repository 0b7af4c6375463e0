//! Covariates of a scale reading: temperatures, feed rates, anything an effect may need.
//!
//! Place in the flow: the driver adds what it knows at the instant of latching; effects look values
//! up by name. The unit is the suffix of the name (`temp_scale_x_c`), as in the campaign's columns.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use super::Text;
use crate::CovariateError;

/// Entries a sample has room for.
pub const COVARIATE_CAPACITY: usize = 32;

/// Bytes a covariate's name may have.
pub const COVARIATE_NAME_CAPACITY: usize = 32;

/// One named value.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend)]
#[type_name("abbe/Covariate")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub struct Covariate {
    /// Name with the unit as suffix.
    pub name: Text<COVARIATE_NAME_CAPACITY>,
    /// Value in the unit of the suffix.
    pub value: f64,
    /// Age of the value at the instant of latching, in seconds.
    pub age_s: f64,
}

/// A table of at most [`COVARIATE_CAPACITY`] covariates, in the order they were added, each name
/// once. A missing covariate is absent, never NaN.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("abbe/Covariates")]
#[allow(unsafe_code)] // The derive implements the unsafe marker trait ZeroCopySend; plain data.
pub struct Covariates {
    // Defaults after the entries, so that comparing the array compares the entries.
    entries: [Covariate; COVARIATE_CAPACITY],
    count: u32,
}

impl Covariates {
    /// An empty table.
    #[must_use]
    pub fn new() -> Self {
        Self { entries: [Covariate::default(); COVARIATE_CAPACITY], count: 0 }
    }

    /// Adds a covariate; `value` in the unit of the name's suffix, `age_s` in seconds.
    ///
    /// # Errors
    /// When the table is full, the name is empty, too long or there already, or a number is not
    /// finite. The table is then unchanged.
    pub fn push(&mut self, name: &str, value: f64, age_s: f64) -> Result<(), CovariateError> {
        let entry = checked_entry(name, value, age_s)?;
        if self.get(name).is_some() {
            return Err(CovariateError::Duplicate { name: name.into() });
        }
        let position = self.len();
        match self.entries.get_mut(position) {
            Some(place) => *place = entry,
            None => {
                return Err(CovariateError::Full { capacity: COVARIATE_CAPACITY });
            }
        }
        self.count += 1;
        Ok(())
    }

    /// The covariate of this name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<Covariate> {
        self.iter().find(|entry| entry.name == *name).copied()
    }

    /// All covariates in the order they were added.
    pub fn iter(&self) -> std::slice::Iter<'_, Covariate> {
        self.entries[..self.len()].iter()
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        // A count beyond the table can only come from foreign memory; check() reports it.
        COVARIATE_CAPACITY.min(self.count as usize)
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The table of the three parallel lists of the message.
    ///
    /// # Errors
    /// When the lists differ in length, or [`Covariates::push`] refuses an entry.
    pub fn from_lists(names: &[String], values: &[f64], ages_s: &[f64]) -> Result<Self, CovariateError> {
        if names.len() != values.len() || names.len() != ages_s.len() {
            return Err(CovariateError::Lengths { names: names.len(), values: values.len(), ages: ages_s.len() });
        }
        let mut table = Self::new();
        for ((name, &value), &age_s) in names.iter().zip(values).zip(ages_s) {
            table.push(name, value, age_s)?;
        }
        Ok(table)
    }

    /// Checks memory that another program wrote: the table must be one that
    /// [`Covariates::push`] could have made.
    ///
    /// # Errors
    /// As [`Covariates::push`]; [`CovariateError::Full`] when the count exceeds the table.
    pub fn check(&self) -> Result<(), CovariateError> {
        if self.count as usize > COVARIATE_CAPACITY {
            return Err(CovariateError::Full { capacity: COVARIATE_CAPACITY });
        }
        for (index, entry) in self.iter().enumerate() {
            let name = entry.name.as_str();
            entry.name.check().map_err(|source| CovariateError::Name { name: name.into(), source })?;
            checked_entry(name, entry.value, entry.age_s)?;
            if self.entries[..index].iter().any(|other| other.name == entry.name) {
                return Err(CovariateError::Duplicate { name: name.into() });
            }
        }
        Ok(())
    }
}

fn checked_entry(name: &str, value: f64, age_s: f64) -> Result<Covariate, CovariateError> {
    if name.is_empty() {
        return Err(CovariateError::EmptyName);
    }
    let fixed_name = Text::new(name).map_err(|source| CovariateError::Name { name: name.into(), source })?;
    for (what, number) in [("value", value), ("age_s", age_s)] {
        if !number.is_finite() {
            return Err(CovariateError::NotFinite { name: name.into(), what, number });
        }
    }
    Ok(Covariate { name: fixed_name, value, age_s })
}

impl Default for Covariates {
    fn default() -> Self {
        Self::new()
    }
}

impl fmt::Debug for Covariates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<'a> IntoIterator for &'a Covariates {
    type Item = &'a Covariate;
    type IntoIter = std::slice::Iter<'a, Covariate>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}
