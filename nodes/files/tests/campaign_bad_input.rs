//! Each thing that can be wrong with a campaign is named with file, line, column and remedy.

use abbe_files::{CampaignFile, FileError, read_campaign};

const HEAD: &str = "station,line,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,length_mm,temp_air_c";
const ROW_1: &str = "S1,S1-00,1.5,600.0,588.0,450.0,0,0,-60,0.0,20.25";
const ROW_2: &str = "S1,S1-00,2.5,600.0,574.133268,450.0,0,0,-60,-8.4489444,";

fn read(text: &str) -> Result<CampaignFile, FileError> {
    read_campaign(text.as_bytes(), "c.csv", None)
}

/// Message of reading these lines.
#[track_caller]
fn refused(lines: &[&str]) -> String {
    read(&lines.join("\n")).unwrap_err().to_string()
}

#[track_caller]
fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "{message:?} does not say {part:?}");
    }
}

/// A spreadsheet or a text program writes U+2212: "is not a number" left nothing to see.
#[test]
fn regress_a_minus_that_is_none_is_named() {
    let message = refused(&[HEAD, &ROW_2.replace("-8.4489444", "\u{2212}8.4489444")]);
    assert_says(&message, &["line 2", "length_mm", "only looks like a minus", "minus of the keyboard"]);
}

#[test]
fn a_good_campaign_is_read_in_si_with_its_covariates() {
    let file = read(&[HEAD, ROW_1, ROW_2].join("\n")).unwrap();
    let campaign = &file.campaign;
    assert_eq!((campaign.stations.as_slice(), campaign.lines.as_slice()), (&["S1".into()][..], &["S1-00".into()][..]));
    let second = campaign.readings[1];
    assert_eq!(second.reading_m, [0.6, 574.133268 / 1e3, 0.45]);
    assert_eq!((second.offset_m, second.length_m, second.time_s), ([0.0, 0.0, -0.06], -8.4489444 / 1e3, 2.5));
    assert_eq!(campaign.covariates.len(), 1);
    assert_eq!(campaign.covariate("temp_air_c").unwrap().values, [Some(20.25), None]);
}

#[test]
fn byte_order_mark_crlf_comments_blank_lines_and_quotes_change_nothing() {
    let plain = read(&[HEAD, ROW_1, ROW_2].join("\n")).unwrap();
    let quoted = ROW_1.replace("S1-00", "\"S1-00\"").replace(",600.0", ", \"600.0\"").replace(", \"", ",\"");
    let text = format!("\u{feff}# measured by night\r\n{HEAD}\r\n\r\n# next\r\n{quoted}\r\n{ROW_2}\r\n");
    let dressed = read(&text).unwrap();
    assert_eq!(dressed.campaign, plain.campaign);
    assert_ne!(dressed.sha256, plain.sha256, "the hash is of the bytes, not of the meaning");
}

#[test]
fn lines_are_counted_right_through_comments_blanks_and_line_ends_in_quotes() {
    let bad = "S1,S1-00,3.5,oops,1,1,0,0,-60,0,";
    for (text, line) in [
        (format!("{HEAD}\n{ROW_1}\n{bad}"), 3),
        (format!("{HEAD}\r\n{ROW_1}\r\n{bad}\r\n{ROW_2}\r\n"), 3),
        (format!("# a\n# b\n{HEAD}\n\n{ROW_1}\n# c\n\n{bad}\n"), 8),
        (format!("{HEAD}\n{}\n{bad}", ROW_1.replace("S1-00", "\"S1\n00\"")), 4),
        (format!("{HEAD}\n{ROW_1}\n{}\n", bad.replace("S1-00", "\"S1\n00\"")), 3),
    ] {
        let error = read(&text).unwrap_err();
        assert_eq!(error.place().unwrap().line, Some(line), "{error} in {text:?}");
        assert_says(&error.to_string(), &["c.csv", "column x_mm", "\"oops\" is not a number", "decimal point"]);
    }
}

#[test]
fn missing_and_misspelt_columns() {
    let without = HEAD.replace(",length_mm", "");
    assert_says(&refused(&[&without, ROW_1]), &["c.csv, line 1, column length_mm", "missing", "add the column"]);
    for (wrong, right) in [("lenght_mm", "length_mm"), ("Time_s", "time_s"), ("X_mm", "x_mm"), ("Station", "station")] {
        let head = HEAD.replacen(right, wrong, 1);
        assert_says(
            &refused(&[&head, ROW_1]),
            &[wrong, "did you mean", &format!("rename the column {wrong} to {right}")],
        );
    }
    let misspelt_offset = HEAD.replace("offset_", "ofset_");
    assert_says(&refused(&[&misspelt_offset, ROW_1]), &["did you mean", "offset_x_mm"]);
    let misspelt_line = HEAD.replace(",line,", ",lines,");
    assert_says(&refused(&[&misspelt_line, ROW_1]), &["column lines", "rename"]);
}

#[test]
fn wrong_unit_suffixes() {
    for (wrong, right, unit) in [
        ("x_m", "x_mm", "millimetres"),
        ("y_um", "y_mm", "millimetres"),
        ("z_inch", "z_mm", "millimetres"),
        ("length_m", "length_mm", "millimetres"),
        ("time_ms", "time_s", "seconds"),
        ("offset_z_m", "offset_z_mm", "millimetres"),
        ("length", "length_mm", "millimetres"),
    ] {
        let columns: Vec<&str> = HEAD.split(',').map(|name| if name == right { wrong } else { name }).collect();
        let message = refused(&[&columns.join(","), ROW_1]);
        assert_says(&message, &[&format!("line 1, column {wrong}"), right, &format!("convert the values to {unit}")]);
    }
}

#[test]
fn offset_columns_stand_together_or_the_machine_declares_one() {
    let two = HEAD.replace("offset_y_mm,", "");
    assert_says(&refused(&[&two, ROW_1]), &["column offset_y_mm", "missing"]);
    let none = HEAD.replace("offset_x_mm,offset_y_mm,offset_z_mm,", "");
    let row = "S1,S1-00,1.5,600.0,588.0,450.0,0.0,20.25";
    assert_says(&refused(&[&none, row]), &["default_offset_mm", "add offset_x_mm"]);
    let text = [none.as_str(), row].join("\n");
    let file = read_campaign(text.as_bytes(), "c.csv", Some([0.0, 0.0, -0.06])).unwrap();
    assert_eq!(file.campaign.readings[0].offset_m, [0.0, 0.0, -0.06]);
    let wrong_unit =
        read_campaign(text.replace("length_mm", "length_mm,offset_x_m").as_bytes(), "c.csv", Some([0.0; 3]));
    assert_says(&wrong_unit.unwrap_err().to_string(), &["column offset_x_m", "millimetres"]);
}

#[test]
fn a_file_without_line_column_has_one_line_a_station() {
    let head = HEAD.replace("line,", "");
    let rows = [ROW_1, ROW_2].map(|row| row.replace("S1-00,", ""));
    let campaign = read(&[head.as_str(), &rows[0], &rows[1]].join("\n")).unwrap().campaign;
    assert_eq!((campaign.lines.as_slice(), campaign.readings[1].line), (&["S1".to_owned()][..], 0));
    let moved = rows[1].replace("-60", "-50");
    assert_says(&refused(&[&head, &rows[0], &moved]), &["line 3, column offset_z_mm", "station S1", "column line"]);
}

#[test]
fn duplicate_columns_and_columns_without_name() {
    assert_says(&refused(&[&HEAD.replace("temp_air_c", "x_mm"), ROW_1]), &["column x_mm", "stands twice", "rename"]);
    assert_says(&refused(&[&HEAD.replace("temp_air_c", ""), ROW_1]), &["column number 11", "no name"]);
}

#[test]
fn cells_that_are_no_finite_number() {
    for (cell, says) in [("NaN", "not a finite"), ("inf", "not a finite"), ("1e999", "not a finite"), ("", "empty")] {
        let row = ROW_2.replace("574.133268", cell);
        assert_says(&refused(&[HEAD, ROW_1, &row]), &["c.csv, line 3, column y_mm", says, "remove the row"]);
    }
    let comma = ROW_2.replace("574.133268", "\"574,13\"");
    assert_says(
        &refused(&[HEAD, ROW_1, &comma]),
        &["line 3, column y_mm", "\"574,13\" marks decimals in another way", "in line 2", "in one way"],
    );
    assert_says(&refused(&[HEAD, ROW_1, &ROW_2.replace("574.133268", "\"1,574.13\"")]), &["marks between thousands"]);
    let covariate = format!("{ROW_2}nan");
    assert_says(&refused(&[HEAD, ROW_1, &covariate]), &["line 3, column temp_air_c", "leave the cell empty"]);
}

#[test]
fn a_further_column_that_is_text_is_refused_by_name() {
    let head = HEAD.replace("temp_air_c", "operator");
    let row = ROW_1.replace("20.25", "Ernst");
    assert_says(&refused(&[&head, &row]), &["line 2, column operator", "\"Ernst\"", "or remove the column"]);
}

/// The lines of a campaign as a European Excel writes them.
fn european(lines: &[&str]) -> String {
    lines.iter().map(|line| line.replace(',', ";").replace('.', ",") + "\r\n").collect()
}

#[test]
fn regress_the_dialects_of_excel_are_the_same_campaign() {
    let plain = read(&[HEAD, ROW_1, ROW_2].join("\n")).unwrap().campaign;
    let semicolons = european(&[HEAD, ROW_1, ROW_2]);
    let tabs = semicolons.replace(';', "\t");
    for text in [
        semicolons.clone(),
        format!("\u{feff}{semicolons}"),
        format!("sep=;\r\n{semicolons}"),
        format!("sep=;;;;;\r\n# by night; and fog\r\n{semicolons}"),
        tabs.clone(),
        format!("sep=\t\n{tabs}"),
        tabs.replace("\r\n", "\r"),
        [HEAD, ROW_1, ROW_2].join("\n").replace(',', ";"),
        semicolons.replace(';', "\",\"").replace("\r\n", "\"\r\n\"").replacen("station", "\"station", 1) + "\"\n",
    ] {
        let text = text.trim_end_matches("\"\"\n");
        let read = read(text).unwrap_or_else(|error| panic!("{error} in {text:?}"));
        assert_eq!(read.campaign, plain, "{text:?}");
    }
}

#[test]
fn regress_a_comma_that_may_stand_between_thousands_is_settled_by_other_numbers_or_refused() {
    let head = HEAD.replace(',', ";");
    // Three decimals everywhere, as a display in micrometres gives them.
    let [open, settles] =
        ["S1;A;1;600,125;588,000;450,500;1;2;60;700,250;", "S1;A;2;600,125;588,000;450,500;1;2;60;7,25;"];
    let message = refused(&[&head, open]);
    assert_says(
        &message,
        &["c.csv, line 2, column x_mm", "\"600,125\" is 600.125 with a decimal comma and 600125 with a comma between"],
    );
    assert_says(&message, &["no number up to here tells which", "# decimal=,"]);
    assert_eq!(read(&[&head, open, settles].join("\n")).unwrap().campaign.readings[0].reading_m[0], 0.600125);
    let declared = read(&["# decimal=,", &head, open].join("\n")).unwrap().campaign;
    assert_eq!(declared.readings[0].length_m, 0.70025);
    assert_says(&refused(&["# decimal=.", &head, open]), &["line 3", "line 1 says decimal=."]);
    let american = open.replace("700,250", "700.5");
    assert_says(&refused(&[&head, &american]), &["column x_mm", "600125", "\"700.5\" in line 2 has a decimal point"]);
    let grouped = open.replace("600,125", "1.600,125");
    assert_says(&refused(&[&head, &grouped]), &["\"1.600,125\" has marks between thousands", "without them"]);
    let mixed = settles.replace("7,25", "7.25").replace("600,125", "0,5");
    assert_says(&refused(&[&head, &mixed]), &["\"7.25\" marks decimals in another way than \"0,5\" in line 2"]);
}

#[test]
fn regress_numbers_are_no_column_names() {
    assert_says(&refused(&[ROW_1, ROW_2]), &["line 1", "holds numbers and no column names", "tail -n +1 -f"]);
    assert_says(&refused(&["a,b;c", "1,2;3"]), &["line 1", "both commas and semicolons", "sep="]);
}

#[test]
fn regress_packed_campaigns_are_read_as_they_are() {
    use std::io::Write;
    let text = [HEAD, ROW_1, ROW_2].join("\n");
    let plain = read(&text).unwrap();
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    gzip.write_all(text.as_bytes()).unwrap();
    for packed in [gzip.finish().unwrap(), zstd::encode_all(text.as_bytes(), 3).unwrap()] {
        let unpacked = read_campaign(packed.as_slice(), "c.csv.gz", None).unwrap();
        assert_eq!(unpacked.campaign, plain.campaign);
        assert_ne!(unpacked.sha256, plain.sha256, "the hash is of the file");
        // Parts one after the other are one text, as gunzip and zstdcat have it.
        let twice = [packed.as_slice(), &packed].concat();
        assert_says(&read_campaign(twice.as_slice(), "c", None).unwrap_err().to_string(), &["line 3"]);
        for length in 5..packed.len() {
            let message = read_campaign(&packed[..length], "c.csv.gz", None).unwrap_err().to_string();
            assert_says(&message, &["c.csv.gz, line", "damaged or cut off", "again"]);
        }
        let mut broken = packed.clone();
        broken[packed.len() / 2] ^= 0x10;
        assert_says(&read_campaign(broken.as_slice(), "c", None).unwrap_err().to_string(), &["c"]);
    }
}

#[test]
fn regress_a_bomb_is_refused_before_it_fills_the_memory() {
    // A gibibyte of blanks without a line end in a few kilobytes.
    let mut bomb = zstd::Encoder::new(Vec::new(), 1).unwrap();
    std::io::copy(&mut std::io::Read::take(std::io::repeat(b' '), 1 << 30), &mut bomb).unwrap();
    let bomb = bomb.finish().unwrap();
    let message = read_campaign(bomb.as_slice(), "bomb.csv.zst", None).unwrap_err().to_string();
    assert_says(&message, &["bomb.csv.zst, line 1", "longer than 4 MiB"]);
    let quoted = format!("{HEAD}\n\"{}", "S1,\n".repeat(2_000_000));
    assert_says(&refused(&[&quoted]), &["c.csv, line", "longer than 4 MiB", "close the quotes"]);
}

#[test]
fn ragged_rows_and_empty_files() {
    assert_says(
        &refused(&[HEAD, ROW_1, "S1,S1-00,2.5,600.0"]),
        &["c.csv, line 3", "4 cells", "header has 11", "cut off"],
    );
    assert_says(&refused(&[HEAD, &format!("{ROW_1},1")]), &["line 2", "12 cells", "semicolons"]);
    assert_says(&refused(&[""]), &["c.csv: the file is empty", "header line"]);
    assert_says(&refused(&["# only a comment", ""]), &["the file is empty"]);
    assert_says(&refused(&[HEAD, ""]), &["line 1", "header but no reading", "one row"]);
}

#[test]
fn time_must_grow_within_a_station_but_stations_may_measure_together() {
    assert_says(
        &refused(&[HEAD, ROW_1, &ROW_2.replace("2.5,", "1.5,")]),
        &["line 3, column time_s", "same", "in line 2", "duplicate"],
    );
    assert_says(
        &refused(&[HEAD, ROW_1, &ROW_2.replace("2.5,", "1.25,")]),
        &["line 3, column time_s", "earlier", "sort"],
    );
    let other = ROW_1.replace("S1", "S2");
    let campaign = read(&[HEAD, ROW_1, &other, ROW_2].join("\n")).unwrap().campaign;
    assert_eq!(campaign.readings.iter().map(|r| r.station).collect::<Vec<_>>(), [0, 1, 0]);
}

#[test]
fn a_line_has_one_station_and_one_offset() {
    let stolen = ROW_2.replace("S1,", "S2,");
    assert_says(
        &refused(&[HEAD, ROW_1, &stolen]),
        &["line 3, column line", "belongs to station S1 since line 2", "S2-S1-00"],
    );
    let turned = ROW_2.replace("-60", "60");
    assert_says(
        &refused(&[HEAD, ROW_1, &turned]),
        &["line 3, column offset_z_mm", "changes its sign", "-60 mm since line 2", "here 60 mm"],
    );
    let changed = ROW_2.replace(",0,0,-60", ",1.5,0,-60");
    let message = refused(&[HEAD, ROW_1, &changed]);
    assert_says(&message, &["column offset_x_mm", "the offset changes within line S1-00"]);
}

#[test]
fn a_name_must_be_there_and_readable() {
    assert_says(&refused(&[HEAD, &ROW_1.replace("S1,", ",")]), &["line 2, column station", "name is empty"]);
    let mut bytes = format!("{HEAD}\n{ROW_1}").into_bytes();
    let at = bytes.iter().rposition(|byte| *byte == b'S').unwrap();
    bytes[at] = 0xff;
    let error = read_campaign(bytes.as_slice(), "c.csv", None).unwrap_err();
    assert_says(&error.to_string(), &["line 2, column line", "UTF-8"]);
}

const PLAIN: &str = "station,time_s,x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,length_mm";

fn at(station: &str, time: &str) -> String {
    format!("{station},{time},600,588,450,0,0,-60,0.5")
}

#[test]
fn times_may_be_date_and_time_of_day_and_then_count_from_the_first_row() {
    let rows = ["2021-06-13T05:00:02", "2021-06-13T05:00:03.5", "2021-06-14 05:00:02"].map(|time| at("S1", time));
    let text = format!("{PLAIN}\n{}\n", rows.join("\n"));
    let times: Vec<f64> = read(&text).unwrap().campaign.readings.iter().map(|reading| reading.time_s).collect();
    assert_eq!(times, [0.0, 1.5, 86_400.0]);
    let refused = |times: [&str; 2]| refused(&[PLAIN, &at("S1", times[0]), &at("S1", times[1])]);
    let seconds = "all times of a file in seconds";
    assert_says(
        &refused(["2021-06-13T05:00:02", "7"]),
        &["line 3, column time_s", "\"7\" is a number, line 2 holds date and time of day", seconds],
    );
    assert_says(&refused(["7", "2021-06-13T05:00:02"]), &["line 3", "line 2 holds a number", seconds]);
    assert_says(&refused(["2021-06-13T05:00:02Z", "2021-06-13T05:00:03"]), &["line 3", "line 2", "time zone"]);
    assert_says(&refused(["13.06.2021 05:00:02", "1"]), &["line 2", "is not a number", "2021-06-13T05:00:02"]);
    assert_says(&refused(["2021-06-13T05:00:02", "2021-06-13T05:00:01"]), &["the time -1 s is earlier than 0 s"]);
}

#[test]
fn a_mark_at_the_end_of_each_line_names_no_column() {
    let plain = read(&format!("{PLAIN}\n{}\n{}\n", at("S1", "1"), at("S1", "2"))).unwrap();
    let marked = |end: &str| read(&format!("{PLAIN},\n{},\n{}{end}\n", at("S1", "1"), at("S1", "2")));
    assert_eq!(marked(",").unwrap().campaign, plain.campaign);
    assert_eq!(marked("").unwrap().campaign, plain.campaign, "the last line may lack it");
    let error = marked(",7").unwrap_err().to_string();
    assert_says(&error, &["line 3, column number 10", "no name and holds something", "name or remove it"]);
    assert_says(&marked(",,").unwrap_err().to_string(), &["line 3", "11 cells"]);
    assert_says(&refused(&[&PLAIN.replace("time_s", ""), "1"]), &["column number 2", "the column has no name"]);
}
