//! Self-contained HTML report, PNG plot and JSON of a run.
