//! Bags give back what was written, say what is wrong with them, and can be recovered.

use crate::common;
use std::path::{Path, PathBuf};

use abbe_msgs::bag::{self, BagError, BagMessage, BagWriter, Qos, Recovery};
use abbe_msgs::standard::PointStamped;
use abbe_msgs::{CorrectedCoordinates, Message, RosType, ScaleReading, TracerReading, cdr, type_description};
use tempfile::TempDir;

/// Writes `rounds` rounds of four messages and returns their topics, times and bytes.
fn write_bag(path: &Path, rounds: u64) -> Vec<(String, u64, Vec<u8>)> {
    let mut writer = BagWriter::create(path).unwrap();
    let written = write_rounds(&mut writer, rounds);
    let summary = writer.finish().unwrap();
    assert_eq!(summary.path, path);
    assert_eq!(summary.messages_by_topic["/machine/scales"], rounds);
    written
}

fn write_rounds(writer: &mut BagWriter, rounds: u64) -> Vec<(String, u64, Vec<u8>)> {
    let mut written = Vec::new();
    let mut note = |topic: &str, time_ns: u64, bytes: Vec<u8>| {
        written.push((topic.to_owned(), time_ns, bytes));
    };
    for round in 0..rounds {
        let time_ns = 1_700_000_000_000_000_000 + round * 1_000_000;
        let mut scales = common::scales();
        scales.sequence = round;
        scales.reading_m[0] += round as f64 * 1.0e-3;
        writer.write("/machine/scales", &scales, time_ns).unwrap();
        note("/machine/scales", time_ns, cdr::encode(&scales.to_ros()).unwrap());
        writer.write("/machine/tracer", &common::tracer(), time_ns + 1).unwrap();
        note("/machine/tracer", time_ns + 1, cdr::encode(&common::tracer().to_ros()).unwrap());
        writer.write("/machine/corrected", &common::corrected(), time_ns + 2).unwrap();
        note("/machine/corrected", time_ns + 2, cdr::encode(&common::corrected().to_ros()).unwrap());
        writer.write_ros("/machine/point", &common::point(), time_ns + 3).unwrap();
        note("/machine/point", time_ns + 3, cdr::encode(&common::point()).unwrap());
    }
    written
}

fn read_all(path: &Path) -> Result<Vec<BagMessage>, BagError> {
    bag::messages(path)?.collect()
}

fn content(messages: &[BagMessage]) -> Vec<(String, u64, Vec<u8>)> {
    let content = |m: &BagMessage| (m.topic().to_owned(), m.log_time_ns, m.cdr.clone());
    messages.iter().map(content).collect()
}

fn folder() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_owned();
    (folder, path)
}

fn message_of(result: Result<Vec<BagMessage>, BagError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn directory_and_bare_file_give_back_the_same_bytes() {
    let (_guard, folder) = folder();
    for path in [folder.join("run"), folder.join("run.mcap")] {
        let written = write_bag(&path, 300);
        let read = read_all(&path).unwrap();
        assert_eq!(content(&read), written);
        let indices: Vec<u64> = read.iter().map(|message| message.index).collect();
        assert_eq!(indices, (0..1200).collect::<Vec<_>>());
        assert_eq!(read[0].ros_type(), "abbe_msgs/msg/ScaleReading");
        let first: ScaleReading = read[0].decode().unwrap();
        assert_eq!(first, ScaleReading { sequence: 0, ..common::scales() });
        assert_eq!(read[3].decode_ros::<PointStamped>().unwrap(), common::point());
    }
    assert!(folder.join("run/run_0.mcap").exists());
    assert!(folder.join("run/metadata.yaml").exists());
    let inner = read_all(&folder.join("run/run_0.mcap")).unwrap();
    assert_eq!(inner.len(), 1200, "the file inside the directory is a bag too");
}

#[test]
fn the_same_messages_give_the_same_bytes() {
    let (_guard, folder) = folder();
    // The same name as well: as rosbag2 has it, a bag names its file inside.
    let bytes = |run: &str| {
        std::fs::create_dir(folder.join(run)).unwrap();
        let path = folder.join(run).join("same.mcap");
        write_bag(&path, 60);
        std::fs::read(path).unwrap()
    };
    assert!(bytes("first") == bytes("second"));
}

#[test]
fn an_empty_bag_is_a_bag() {
    let (_guard, folder) = folder();
    let path = folder.join("empty");
    BagWriter::create(&path).unwrap().finish().unwrap();
    assert_eq!(read_all(&path).unwrap().len(), 0);
}

#[test]
fn every_flipped_bit_is_noticed() {
    let (_guard, folder) = folder();
    let path = folder.join("small.mcap");
    write_bag(&path, 2);
    let good = std::fs::read(&path).unwrap();
    for at in 0..good.len() {
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (at % 8);
        let faults = bag::messages_from(&path, bytes.as_slice()).filter(Result::is_err);
        assert_eq!(faults.count(), 1, "byte {at} of {}", good.len());
    }
}

#[test]
fn a_bag_cut_off_anywhere_is_an_error_after_the_messages_before() {
    let (_guard, folder) = folder();
    let path = folder.join("run.mcap");
    let written = write_bag(&path, 60);
    let good = std::fs::read(&path).unwrap();
    for length in (0..good.len()).step_by(7) {
        let read: Vec<_> = bag::messages_from(&path, &good[..length]).collect();
        let (last, before) = read.split_last().unwrap();
        let before: Vec<_> = before.iter().map(|m| m.as_ref().unwrap().clone()).collect();
        assert!(written.starts_with(&content(&before)), "cut at {length}");
        let error = last.as_ref().unwrap_err();
        let BagError::Damaged { messages_read, .. } = error else {
            panic!("cut at {length}: {error}");
        };
        assert_eq!(*messages_read, before.len() as u64);
        let text = error.to_string();
        assert!(text.contains("run.mcap") && text.contains("recover the bag"), "{text}");
    }
}

#[test]
fn a_killed_recording_is_recovered_but_for_the_last_hundred_messages() {
    let (_guard, folder) = folder();
    let path = folder.join("killed");
    let mut writer = BagWriter::create(&path).unwrap();
    let written = write_rounds(&mut writer, 300);
    std::mem::forget(writer); // as kill -9: nothing is flushed, nothing completed
    let (read, error) = read_until_error(&path);
    assert!(read.len() >= 1100 && content(&read) == written[..read.len()], "what is there can be read");
    assert!(error.contains("damaged or cut off") && error.contains("recover the bag"), "{error}");

    let out = folder.join("saved");
    let recovery = bag::recover(&path, &out).unwrap();
    assert!(recovery.messages_saved >= 1100, "{recovery:?}");
    assert!(!recovery.is_complete() && recovery.messages_missing().is_none(), "nobody knows what is missing");
    assert_eq!(faults(&recovery), 1, "{recovery:?}");
    let saved = read_all(&out).unwrap();
    assert_eq!(saved.len() as u64, recovery.messages_saved);
    assert_eq!(content(&saved), written[..saved.len()]);
}

/// What can be read, and the error after it.
fn read_until_error(path: &Path) -> (Vec<BagMessage>, String) {
    let mut read: Vec<_> = bag::messages(path).unwrap().collect();
    let error = read.pop().unwrap().unwrap_err().to_string();
    (read.into_iter().map(Result::unwrap).collect(), error)
}

fn faults(recovery: &Recovery) -> usize {
    recovery.files.iter().map(|file| file.faults.len()).sum()
}

/// A bag in three files of `rounds` rounds each.
fn write_split(path: &Path, rounds: u64) -> Vec<(String, u64, Vec<u8>)> {
    let mut writer = BagWriter::create(path).unwrap();
    let mut written = Vec::new();
    for part in 0..3 {
        if part > 0 {
            writer.split().unwrap();
        }
        written.extend(write_rounds(&mut writer, rounds));
    }
    assert_eq!((writer.files(), writer.message_count()), (3, 12 * rounds));
    assert_eq!(writer.finish().unwrap().messages_by_topic["/machine/scales"], 3 * rounds);
    written
}

#[test]
fn a_split_bag_gives_back_its_messages_in_order_and_each_file_is_a_bag() {
    let (_guard, folder) = folder();
    let path = folder.join("run");
    let written = write_split(&path, 100);
    assert_eq!(content(&read_all(&path).unwrap()), written);
    for number in 0..3 {
        let file = read_all(&path.join(format!("run_{number}.mcap"))).unwrap();
        assert_eq!(content(&file), written[number * 400..(number + 1) * 400]);
    }
    let yaml = std::fs::read_to_string(path.join("metadata.yaml")).unwrap();
    assert_eq!(yaml.matches("message_count: 400").count(), 3, "{yaml}");
    let error = BagWriter::create(folder.join("bare.mcap")).unwrap().split().unwrap_err().to_string();
    assert!(error.contains("cannot be split; name a directory"), "{error}");
}

#[test]
fn a_split_that_holds_nothing_makes_no_file() {
    let (_guard, folder) = folder();
    let path = folder.join("run");
    let mut writer = BagWriter::create(&path).unwrap();
    writer.split().unwrap();
    assert_eq!(writer.files(), 1);
    writer.finish().unwrap();
    assert_eq!(read_all(&path).unwrap().len(), 0);
}

#[test]
fn a_bag_whose_last_file_is_cut_is_read_up_to_there() {
    let (_guard, folder) = folder();
    let path = folder.join("killed");
    let mut writer = BagWriter::create(&path).unwrap();
    let mut written = write_rounds(&mut writer, 100);
    writer.split().unwrap();
    written.extend(write_rounds(&mut writer, 100));
    writer.flush().unwrap();
    std::mem::forget(writer);
    let (read, error) = read_until_error(&path);
    assert_eq!(content(&read), written);
    assert!(error.contains("killed_1.mcap: damaged or cut off after 400 readable messages"), "{error}");
    // Even where the last file happens to be whole, the recording is not.
    write_bag(&folder.join("whole.mcap"), 1);
    std::fs::rename(folder.join("whole.mcap"), path.join("killed_1.mcap")).unwrap();
    let (read, error) = read_until_error(&path);
    assert_eq!(read.len(), 404);
    assert!(error.contains("does not name killed_1.mcap") && error.contains("not finished"), "{error}");
}

#[test]
fn regress_one_flipped_bit_costs_its_chunk_and_the_rest_is_recovered() {
    let (_guard, folder) = folder();
    let path = folder.join("run.mcap");
    let written = write_bag(&path, 1000);
    let mut bytes = std::fs::read(&path).unwrap();
    // In the packed records of the first chunk after a tenth of the file.
    let tenth = bytes.len() / 10;
    let at = tenth + bytes[tenth..].windows(3).position(|window| window == b"lz4").unwrap() + 200;
    bytes[at] ^= 4;
    std::fs::write(&path, bytes).unwrap();
    let recovery = bag::recover(&path, folder.join("saved.mcap")).unwrap();
    let saved = content(&read_all(&folder.join("saved.mcap")).unwrap());
    assert!(saved.len() >= written.len() - 100, "{recovery:?}");
    assert_eq!(recovery.messages_missing(), Some((written.len() - saved.len()) as u64), "{recovery:?}");
    assert!(!recovery.is_complete());
    let file = &recovery.files[0];
    assert_eq!(file.chunks_named.unwrap() - file.chunks_saved, 1);
    let told = file.faults[0].to_string();
    assert!(told.contains("bytes ") && told.contains("between 1700000000."), "{told}");
    let before = saved.iter().zip(&written).take_while(|(a, b)| a == b).count();
    assert_eq!(saved[before..], written[written.len() - (saved.len() - before)..], "nothing else is missing");
}

#[test]
fn a_file_that_metadata_names_and_that_is_gone_is_told_with_its_messages() {
    let (_guard, folder) = folder();
    let path = folder.join("run");
    let written = write_split(&path, 50);
    std::fs::remove_file(path.join("run_1.mcap")).unwrap();
    let recovery = bag::recover(&path, folder.join("saved")).unwrap();
    assert_eq!((recovery.messages_saved, recovery.messages_missing()), (400, Some(200)));
    assert!(recovery.files[1].faults[0].to_string().contains("missing, although metadata.yaml names it"));
    let saved = content(&read_all(&folder.join("saved")).unwrap());
    assert_eq!(saved, [&written[..200], &written[400..]].concat());
}

#[test]
fn what_is_no_bag_or_holds_nothing_is_not_recovered() {
    let (_guard, folder) = folder();
    let cases: [(&str, &[u8], &str); 4] = [
        ("table.mcap", b"x_mm,y_mm,z_mm\n1,2,3\n", "does not begin as MCAP does"),
        ("empty.mcap", b"", "the file is empty"),
        ("magic.mcap", mcap::MAGIC, "not finished"),
        ("text.mcap", b"a", "does not begin as MCAP does"),
    ];
    for (name, bytes, says) in cases {
        std::fs::write(folder.join(name), bytes).unwrap();
        let error = bag::recover(folder.join(name), folder.join("out")).unwrap_err().to_string();
        assert!(error.contains("not a bag") && error.contains(says) && error.contains("name a .mcap"), "{error}");
        assert!(!folder.join("out").exists(), "no output is left");
    }
}

#[test]
fn recovery_keeps_schemas_and_quality_of_service() {
    let (_guard, folder) = folder();
    let path = folder.join("run.mcap");
    let mut writer = BagWriter::create(&path).unwrap();
    writer.set_qos("/model", Qos::LATCHED);
    writer.write("/model", &common::corrected(), 5).unwrap();
    writer.finish().unwrap();
    let again = folder.join("again/run.mcap");
    std::fs::create_dir(folder.join("again")).unwrap();
    let recovery = bag::recover(&path, &again).unwrap();
    assert!(recovery.is_complete() && faults(&recovery) == 0, "nothing is wrong with it");
    let (before, after) = (read_all(&path).unwrap(), read_all(&again).unwrap());
    assert_eq!(before[0].channel(), after[0].channel());
    assert!(after[0].channel().offered_qos_profiles.contains("durability: 1"));
    let hash = type_description::hash(CorrectedCoordinates::ROS_TYPE).unwrap();
    assert!(hash.starts_with("RIHS01_") && after[0].channel().type_hash == hash, "{:?}", after[0].channel());
    assert!(std::fs::read(&path).unwrap() == std::fs::read(&again).unwrap());
}

#[test]
fn what_is_there_is_not_overwritten() {
    let (_guard, folder) = folder();
    for name in ["run", "run.mcap"] {
        write_bag(&folder.join(name), 1);
        let error = BagWriter::create(folder.join(name)).err().unwrap();
        assert!(matches!(error, BagError::Exists { .. }), "{error}");
        let error = bag::recover(folder.join(name), folder.join(name)).unwrap_err();
        assert!(matches!(error, BagError::Exists { .. }), "{error}");
        assert_eq!(read_all(&folder.join(name)).unwrap().len(), 4);
    }
}

#[test]
fn a_topic_has_one_type_and_samples_are_checked_before_they_are_written() {
    let (_guard, folder) = folder();
    let mut writer = BagWriter::create(folder.join("run.mcap")).unwrap();
    writer.write("/a", &common::scales(), 1).unwrap();
    let error = writer.write("/a", &common::tracer(), 2).unwrap_err().to_string();
    assert!(error.contains("/a carries abbe_msgs/msg/ScaleReading already"), "{error}");
    let mut wrong = common::tracer();
    wrong.length_m = f64::NAN;
    let error = writer.write("/b", &wrong, 3).unwrap_err().to_string();
    assert!(error.contains("length_m is NaN"), "{error}");
    let error = writer.write_cdr("/c", "other_msgs/msg/Other", &[0, 1, 0, 0], 4).unwrap_err();
    assert!(error.to_string().contains("no .msg text of other_msgs/msg/Other"));
    writer.finish().unwrap();
    let read = read_all(&folder.join("run.mcap")).unwrap();
    assert_eq!(read.len(), 1, "what was refused left nothing behind");
    let error = read[0].decode::<TracerReading>().unwrap_err().to_string();
    assert!(error.contains("carries abbe_msgs/msg/ScaleReading, not"), "{error}");
}

#[test]
fn what_is_no_bag_is_named() {
    let (_guard, folder) = folder();
    let missing = folder.join("missing.mcap");
    assert!(message_of(read_all(&missing)).contains("missing.mcap: cannot open the bag"));
    assert!(message_of(read_all(&folder)).contains("metadata.yaml: missing"));
    let error = bag::recover(&folder, folder.join("out")).unwrap_err().to_string();
    assert!(error.contains("holds no .mcap file"), "{error}");
    assert!(!folder.join("out").exists(), "no output is left");
    let text = folder.join("table.mcap");
    std::fs::write(&text, "x_mm,y_mm\n1,2\n3,4\n").unwrap();
    assert!(message_of(read_all(&text)).contains("table.mcap: not a bag"));
}

#[test]
fn metadata_that_contradicts_the_files_is_an_error() {
    let (_guard, folder) = folder();
    let path = folder.join("run");
    write_bag(&path, 2);
    let yaml = path.join("metadata.yaml");
    let good = std::fs::read_to_string(&yaml).unwrap();
    let after = |from: &str, to: &str| {
        assert!(good.contains(from), "{from} is not in {good}");
        std::fs::write(&yaml, good.replacen(from, to, 1)).unwrap();
        message_of(read_all(&path))
    };
    assert!(after("message_count: 8", "message_count: 9").contains("names 9 messages"));
    assert!(after("storage_identifier: mcap", "storage_identifier: sqlite3").contains("'sqlite3'"));
    assert!(after("compression_mode: \"\"", "compression_mode: FILE").contains("mode 'file'"));
    assert!(after("- \"run_0.mcap\"", "- \"run_1.mcap\"").contains("run_1.mcap: cannot open"));
    assert!(after("relative_file_paths", "files_of").contains("relative_file_paths"));
    assert!(after("version: 8", "version: [").contains("not the metadata of a rosbag2 bag"));
    std::fs::write(&yaml, [0xff, 0xfe]).unwrap();
    assert!(message_of(read_all(&path)).contains("cannot read the metadata"));
}

/// What stands in the error of a bag that only rosbag2 reads, from the command on.
fn conversion_in(said: &str) -> &str {
    said.split_once("; convert the bag with ROS 2:\n").unwrap_or_else(|| panic!("{said}")).1
}

#[test]
fn a_bag_that_only_rosbag2_reads_is_refused_with_the_whole_command_that_converts_it() {
    let (_guard, folder) = folder();
    let path = folder.join("run.v2");
    write_bag(&path, 2);
    let yaml = path.join("metadata.yaml");
    let good = std::fs::read_to_string(&yaml).unwrap();
    let after = |from: &str, to: &str| {
        assert!(good.contains(from), "{from} is not in {good}");
        std::fs::write(&yaml, good.replacen(from, to, 1)).unwrap();
        message_of(read_all(&path))
    };
    let commands = |input: &str, output: &str| {
        let [input, output] = [input, output].map(|name| folder.join(name).display().to_string());
        format!(
            "  echo 'output_bags: [{{uri: \"{output}\", storage_id: mcap, all_topics: true}}]' > out.yaml\n  \
             ros2 bag convert -i {input} -o out.yaml"
        )
    };
    for said in [
        after("storage_identifier: mcap", "storage_identifier: sqlite3"),
        after("compression_mode: \"\"", "compression_mode: FILE"),
        after("compression_mode: \"\"", "compression_mode: MESSAGE"),
    ] {
        assert_eq!(conversion_in(&said), commands("run.v2", "run.v2_mcap"), "{said}");
    }

    // Where a file is named, the folder that it belongs to has all of the bag.
    let sqlite = [b"SQLite format 3\0".as_slice(), &[16; 84]].concat();
    for (file, input, output) in
        [("run.v2/run_0.db3", "run.v2", "run.v2_mcap"), ("alone_0.db3", "alone_0.db3", "alone_0_mcap")]
    {
        let file = folder.join(file);
        std::fs::write(&file, &sqlite).unwrap();
        let recovering = bag::recover(&file, folder.join("saved")).unwrap_err().to_string();
        for said in [message_of(read_all(&file)), recovering] {
            assert!(said.starts_with(&format!("{}: storage is SQLite", file.display())), "{said}");
            assert_eq!(conversion_in(&said), commands(input, output), "{said}");
        }
    }
    std::fs::write(folder.join("table.db3"), "SQLite format 2").unwrap();
    assert!(message_of(read_all(&folder.join("table.db3"))).contains("not a bag"), "it is told by its first bytes");
}

#[test]
fn a_folder_of_files_that_only_rosbag2_reads_is_refused_with_what_makes_its_metadata() {
    let (_guard, folder) = folder();
    let refused = |bag: &Path| {
        let read = message_of(read_all(bag));
        assert_eq!(bag::recover(bag, folder.join("saved")).unwrap_err().to_string(), read);
        read
    };
    let run = folder.join("my run");
    std::fs::create_dir(&run).unwrap();
    let sqlite = [b"SQLite format 3\0".as_slice(), &[16; 84]].concat();
    for name in ["run_1.db3", "run_0.db3"] {
        std::fs::write(run.join(name), &sqlite).unwrap();
    }
    let said = refused(&run);
    assert!(said.starts_with(&format!("{}: storage is SQLite", run.join("run_0.db3").display())), "{said}");
    let commands = format!("ros2() {{ printf '%s\\n' \"$@\"; }}\n{}", conversion_in(&said));
    let shell = std::process::Command::new("sh").args(["-c", &commands]).current_dir(&folder).output().unwrap();
    assert!(shell.status.success(), "{}", String::from_utf8_lossy(&shell.stderr));
    let input = run.display();
    let words = format!("bag\nreindex\n-s\nsqlite3\n{input}\nbag\nconvert\n-i\n{input}\n-o\nout.yaml\n");
    assert_eq!(String::from_utf8(shell.stdout).unwrap(), words);

    let packed = folder.join("packed");
    std::fs::create_dir(&packed).unwrap();
    std::fs::write(packed.join("packed_0.mcap.zstd"), [0x28, 0xb5, 0x2f, 0xfd]).unwrap();
    let said = refused(&packed);
    assert!(said.contains(&format!("zstd --decompress {}/*.zstd", packed.display())), "{said}");
    // What is no bag at all is still told so.
    let empty = folder.join("empty");
    std::fs::create_dir(&empty).unwrap();
    assert!(message_of(read_all(&empty)).contains("metadata.yaml: missing"));
}

#[test]
fn a_shell_takes_the_command_that_converts_a_bag_as_it_is_meant() {
    let (_guard, folder) = folder();
    let path = folder.join("it's a run");
    std::fs::create_dir(&path).unwrap();
    let metadata =
        "rosbag2_bagfile_information: {storage_identifier: sqlite3, relative_file_paths: [], message_count: 0}";
    std::fs::write(path.join("metadata.yaml"), metadata).unwrap();
    let said = message_of(read_all(&path));
    let commands = format!("ros2() {{ printf '%s\\n' \"$@\"; }}\n{}", conversion_in(&said));
    let shell = std::process::Command::new("sh").args(["-c", &commands]).current_dir(&folder).output().unwrap();
    assert!(shell.status.success(), "{}", String::from_utf8_lossy(&shell.stderr));
    let words = format!("bag\nconvert\n-i\n{}\n-o\nout.yaml\n", path.display());
    assert_eq!(String::from_utf8(shell.stdout).unwrap(), words);
    let written = std::fs::read_to_string(folder.join("out.yaml")).unwrap();
    let uri = format!("{}_mcap", path.display());
    assert_eq!(written, format!("output_bags: [{{uri: \"{uri}\", storage_id: mcap, all_topics: true}}]\n"));
}

/// A directory split into several files, as `ros2 bag record --max-bag-size` leaves it.
#[test]
fn split_recordings_are_read_in_order() {
    let (_guard, folder) = folder();
    let path = folder.join("run");
    let first = write_bag(&path, 1);
    write_bag(&folder.join("more.mcap"), 2);
    std::fs::rename(folder.join("more.mcap"), path.join("run_1.mcap")).unwrap();
    let yaml = path.join("metadata.yaml");
    let text = std::fs::read_to_string(&yaml).unwrap();
    let text = text.replacen("- \"run_0.mcap\"", "- run_0.mcap\n    - run/run_1.mcap", 1).replacen(
        "message_count: 4",
        "message_count: 12",
        1,
    );
    std::fs::write(&yaml, text).unwrap();
    let read = read_all(&path).unwrap();
    assert_eq!(read.len(), 12);
    assert_eq!(content(&read)[..4], first);
    assert_eq!(read[11].index, 11);
    let recovery = bag::recover(&path, folder.join("joined")).unwrap();
    assert_eq!(recovery.messages_saved, 12);
}

#[test]
fn standard_types_are_named_as_ros_names_them() {
    assert_eq!(PointStamped::ROS_TYPE, "geometry_msgs/msg/PointStamped");
    assert_eq!(ScaleReading::ROS_TYPE, "abbe_msgs/msg/ScaleReading");
}
