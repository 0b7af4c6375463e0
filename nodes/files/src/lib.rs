//! Reading and writing of machine, campaign, model and point files.
//!
//! Place in the flow: everything that enters Abbe from a file or leaves it as one passes here. Files carry mm, µm
//! and degrees Celsius with the unit in the name; behind these readers everything is SI. A reader names file,
//! line and column of what is wrong and says what to do; a writer leaves a whole file or none.

mod atomic;
mod campaign_csv;
mod campaign_writer;
mod capture_journal;
mod columns;
mod conformity_csv;
mod csv_bytes;
mod csv_source;
mod day;
mod decimals;
mod diagonals_csv;
mod dialect;
mod envelope;
mod error;
pub mod export;
mod fixed;
mod guideway_csv;
mod identity;
mod identity_file;
mod instants;
mod machine;
mod machine_document;
mod model_contents;
mod model_file;
mod model_record;
mod names;
mod notice;
mod plan_path;
mod plan_request;
mod plausible;
mod points_csv;
mod predicted_csv;
mod ram_turn_record;
mod residual_csv;
mod residual_file;
mod study_csv;
mod table_facts;
mod tips;
mod toml_place;
mod units;
mod vectors_csv;

pub use atomic::{AtomicFile, Unfinished, put_in_place, remove_unfinished, write_atomically};
pub use campaign_csv::{CampaignFile, read_campaign, read_campaign_file};
pub use campaign_writer::write_campaign;
pub use capture_journal::{CaptureJournal, Captured, JournalEntry, JournalHead};
pub use conformity_csv::{
    LengthFile, ProbedPoints, read_lengths, read_lengths_file, read_probed_points, read_probed_points_file,
};
pub use csv_source::header_names;
pub use day::{Day, Days};
pub use diagonals_csv::{DiagonalReading, read_diagonals, read_diagonals_file};
pub use dialect::cell_text;
pub use envelope::{hex, sha256_hex, sha256_of_hex};
pub use error::{FileError, Place};
pub use guideway_csv::{GuidewayRow, SeenTarget, read_guideway, read_guideway_file};
pub use identity::{Contact, Identity, InstrumentIdentity, PerformedAt};
pub use identity_file::read_identity;
pub use machine::{MachineFile, OrderChoice, SIGN_CONVENTION, machine_text, parse_machine, read_machine};
pub use model_contents::{DataSource, Doubt, ModelFile, ResidualReference};
pub use plan_path::{PathLine, PathStation, dme, gcode, path_csv, read_path, stations_csv};
pub use plan_request::{PlanRequestFile, parse_plan_request, read_plan_request};
pub use points_csv::{
    ADDED_COLUMNS, CovariatePlace, PointRow, PointsReader, PointsWriter, RowCovariates, RowsForm, RowsText, status_word,
};
pub use predicted_csv::{PlainPoints, PredictedWriter};
pub use residual_csv::{ResidualOrigin, read_residual_origin, write_residual_vectors};
pub use residual_file::{LoadedResidual, ResidualFile, ResidualOwner};
pub use study_csv::{
    StudyFile, read_component_vectors, read_component_vectors_file, read_input_vectors_file, read_plane_vectors,
    read_plane_vectors_file, read_residual_vectors, read_residual_vectors_file, read_runs, read_runs_file,
    read_sphere_centres, read_sphere_centres_file,
};
pub use table_facts::{TableFacts, is_temperature};
pub use tips::{is_one_tip, offset_words, refuse_several_tips, tip_of};
pub use vectors_csv::{
    ErrorVector, Lacks, Positions, read_plane_positions_file, read_positions, read_positions_file, write_error_vectors,
    write_plane_errors,
};
