//! A tracer campaign in memory: the one form that files, bags and the simulator produce.
//!
//! Inputs and outputs are SI in the machine frame. Rows are kept in the order in which they were measured.
//! A reading names its station and line by index, so that a million of them stay small.

/// One static tracer reading with the scale readings latched at the same instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangeReading {
    /// Index into [`Campaign::stations`].
    pub station: u32,
    /// Index into [`Campaign::lines`].
    pub line: u32,
    /// Seconds since the campaign began.
    pub time_s: f64,
    /// Indicated axis positions X, Y, Z (m, machine frame).
    pub reading_m: [f64; 3],
    /// Reflector relative to the ram reference point (m, ram frame).
    pub offset_m: [f64; 3],
    /// Interferometric length relative to the station's first reading (m).
    pub length_m: f64,
}

/// A logged quantity beside the readings, such as `temp_scale_x_c`; the unit is the suffix of the name.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariate {
    /// Column name with the unit as suffix.
    pub name: String,
    /// One value a reading, in the unit of the suffix; `None` where nothing was logged.
    pub values: Vec<Option<f64>>,
}

/// A tracer campaign: readings of one or more stations and everything logged beside them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Campaign {
    /// Station names in the order of their first reading.
    pub stations: Vec<String>,
    /// Line names (runs of points measured in one go) in the order of their first reading.
    pub lines: Vec<String>,
    /// The readings in the order in which they were measured.
    pub readings: Vec<RangeReading>,
    /// Everything else that was logged, one entry a column.
    pub covariates: Vec<Covariate>,
}

impl Campaign {
    /// The covariate of that name, if it was logged.
    pub fn covariate(&self, name: &str) -> Option<&Covariate> {
        self.covariates.iter().find(|c| c.name == name)
    }

    /// The readings at these indices with their covariates; station and line names stay.
    ///
    /// Indices must be those of readings.
    pub fn part(&self, indices: &[usize]) -> Campaign {
        let covariate = |column: &Covariate| Covariate {
            name: column.name.clone(),
            values: indices.iter().map(|k| column.values.get(*k).copied().flatten()).collect(),
        };
        Campaign {
            stations: self.stations.clone(),
            lines: self.lines.clone(),
            readings: indices.iter().filter_map(|k| self.readings.get(*k)).copied().collect(),
            covariates: self.covariates.iter().map(covariate).collect(),
        }
    }
}
