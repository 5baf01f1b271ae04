//! Typed columns: CSV and Parquet with the same rows, the same bytes every time, read back by the library's own reader.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use host_sim::report::table::{Column, Table};
use kit::files::write_whole;
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use std::fs::File;

/// CRC-64/XZ, as files are pinned here.
fn checksum(bytes: &[u8]) -> u64 {
    crc::Crc::<u64>::new(&crc::CRC_64_XZ).checksum(bytes)
}

fn reader(bytes: &[u8]) -> SerializedFileReader<File> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("table.parquet");
    write_whole(&path, bytes).unwrap();
    SerializedFileReader::new(File::open(&path).unwrap()).unwrap()
}

fn small() -> Table {
    Table::new(vec![
        Column::text("policy", ["actor", "a \"b\", c", "ä"].map(str::to_owned)),
        Column::unsigned("slots", [2000, u64::MAX, 0]),
        Column::signed("shift", [Some(-3), None, Some(i64::MIN)]),
        Column::number("mean_age_ms", [Some(1.0 / 3.0), None, Some(f64::NAN)]),
    ])
    .unwrap()
}

#[test]
fn csv_has_the_columns_and_exact_values() {
    assert_eq!(
        small().to_csv(),
        "policy,slots,shift,mean_age_ms\nactor,2000,-3,0.3333333333333333\n\
         \"a \"\"b\"\", c\",18446744073709551615,,\nä,0,-9223372036854775808,NaN\n"
    );
    let none = Table::new(vec![
        Column::number("a", Vec::<f64>::new()),
        Column::text("b", Vec::<String>::new()),
    ]);
    assert_eq!(none.unwrap().to_csv(), "a,b\n");
}

#[test]
fn parquet_reads_back_with_types_and_missing_values() {
    let reader = reader(&small().to_parquet().unwrap());
    let rows: Vec<Vec<Field>> = reader
        .get_row_iter(None)
        .unwrap()
        .map(|row| {
            row.unwrap()
                .get_column_iter()
                .map(|(_, field)| field.clone())
                .collect()
        })
        .collect();
    assert_eq!(rows.len(), 3);
    assert_eq!(
        rows[0],
        [
            Field::Str("actor".to_owned()),
            Field::ULong(2000),
            Field::Long(-3),
            Field::Double(1.0 / 3.0)
        ]
    );
    assert_eq!(
        rows[1],
        [
            Field::Str("a \"b\", c".to_owned()),
            Field::ULong(u64::MAX),
            Field::Null,
            Field::Null
        ]
    );
    assert_eq!(
        rows[2][..3],
        [Field::Str("ä".to_owned()), Field::ULong(0), Field::Long(i64::MIN)]
    );
    assert!(matches!(rows[2][3], Field::Double(value) if value.is_nan()));
    let names: Vec<String> = reader
        .metadata()
        .file_metadata()
        .schema()
        .get_fields()
        .iter()
        .map(|field| field.name().to_owned())
        .collect();
    assert_eq!(names, ["policy", "slots", "shift", "mean_age_ms"]);
}

#[test]
fn many_rows_take_fixed_row_groups_and_pinned_bytes() {
    let rows = 300_000_u64;
    let table = || {
        Table::new(vec![
            Column::unsigned("link", 0..rows),
            Column::text("zone", (0..rows).map(|row| format!("zone {}", row % 24))),
            Column::number("volume", (0..rows).map(|row| row as f64 / 7.0)),
        ])
        .unwrap()
    };
    let bytes = table().to_parquet().unwrap();
    assert_eq!(bytes, table().to_parquet().unwrap());
    let reader = reader(&bytes);
    let groups: Vec<i64> = reader
        .metadata()
        .row_groups()
        .iter()
        .map(|group| group.num_rows())
        .collect();
    assert_eq!(groups, [131_072, 131_072, 37_856]);
    let last = reader.get_row_iter(None).unwrap().last().unwrap().unwrap();
    let last: Vec<Field> = last.get_column_iter().map(|(_, field)| field.clone()).collect();
    assert_eq!(
        last,
        [
            Field::ULong(299_999),
            Field::Str("zone 23".to_owned()),
            Field::Double(299_999.0 / 7.0)
        ]
    );
    // A newer writer may choose other bytes; then files of two versions differ, which CHANGELOG.md has to say.
    assert_eq!(
        (bytes.len(), checksum(&bytes)),
        (4_992_153, 7_430_829_460_581_436_551)
    );
}

#[test]
fn columns_that_are_no_table_are_refused() {
    let message = |columns| Table::new(columns).unwrap_err().to_string();
    assert_eq!(
        message(vec![Column::number("a", [1.0]), Column::number("b", [1.0, 2.0])]),
        "column b: found 2 values, expected 1"
    );
    assert_eq!(
        message(vec![Column::number("a", [1.0]), Column::unsigned("a", [1])]),
        "column a: found its name twice, expected once"
    );
}
