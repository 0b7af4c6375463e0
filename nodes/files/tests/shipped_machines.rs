//! Every machine file that ships is read, makes a layout, and survives being written.

use abbe_files::{machine_text, parse_machine, read_machine};
use abbe_geometry::layout::Layout;
use std::path::Path;

#[test]
fn every_shipped_machine_loads_and_is_written_back_the_same() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/machines");
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let file = read_machine(&path).unwrap();
        assert!(Layout::new(&file.machine, [0.0; 3]).unwrap().len() > 21, "{}", path.display());
        assert_eq!(Some(file.machine.name.as_str()), path.file_stem().and_then(|stem| stem.to_str()));
        let text = machine_text(&file).unwrap();
        assert_eq!(parse_machine(&text, "written").unwrap(), file, "{text}");
        names.push(file.machine.name);
    }
    names.sort();
    for name in ["bridge_xyz", "fyxz", "moving_table"] {
        assert!(names.iter().any(|known| known == name), "{name} is not shipped");
    }
}
