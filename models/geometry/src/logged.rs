//! All covariates that a machine with every sensor logs, for tests: of this crate, and of those that check it.

/// Their names; time first.
pub(crate) const LOGGED: [&str; 18] = [
    "time_s",
    "dir_x",
    "dir_y",
    "dir_z",
    "speed_mm_s",
    "acc_x_mm_s2",
    "acc_y_mm_s2",
    "acc_z_mm_s2",
    "load_kg",
    "temp_air_c",
    "temp_scale_x_c",
    "temp_scale_y_c",
    "temp_scale_z_c",
    "temp_bridge_top_c",
    "temp_bridge_bottom_c",
    "temp_granite_c",
    "pressure_hpa",
    "humidity_pct",
];
