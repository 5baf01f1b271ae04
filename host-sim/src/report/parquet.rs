//! A [`Table`] as one Parquet file with the same bytes on every machine and at every time.
//!
//! Text is `BYTE_ARRAY` (string), counts are `INT64` (unsigned), integers `INT64`, numbers `DOUBLE`; every column is
//! optional, so that the schema does not depend on whether a value is missing. No compression, no timestamp, no
//! version of a library: the same table gives the same bytes.
//!
//! # Source
//! Apache Parquet format 2; logical types as in its `LogicalTypes.md`.

use super::table::{Column, Table, Values};
use kit::error::{Error, Result};
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{ColumnPath, Type};
use std::ops::Range;
use std::sync::Arc;

/// Rows of a row group, but for the last (chosen: a reader's usual unit of work).
const ROWS_PER_GROUP: usize = 1 << 17;

/// Who wrote the file, as its footer says; without a version, which would change the bytes.
const WRITER: &str = "freshlane";

impl Table {
    /// The table as a Parquet file, ready for [`write_whole`](kit::files::write_whole).
    ///
    /// # Errors
    /// [`Error::Input`] if the table has more than the format can hold.
    pub fn to_parquet(&self) -> Result<Vec<u8>> {
        self.encode()
            .map_err(|error| Error::input("Parquet file", error, "a table that the format can hold"))
    }

    fn encode(&self) -> std::result::Result<Vec<u8>, ParquetError> {
        let fields: std::result::Result<Vec<_>, _> = self.columns().iter().map(field).collect();
        let schema = Type::group_type_builder("table").with_fields(fields?).build()?;
        // Text repeats itself; a dictionary of numbers would be given up after its first megabyte.
        let mut properties = WriterProperties::builder()
            .set_created_by(WRITER.to_owned())
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_dictionary_enabled(false);
        for column in self.columns() {
            if matches!(column.values, Values::Text(_)) {
                let path = ColumnPath::new(vec![column.name.clone()]);
                properties = properties.set_column_dictionary_enabled(path, true);
            }
        }
        let properties = properties.build();
        let mut bytes = Vec::new();
        let mut file = SerializedFileWriter::new(&mut bytes, Arc::new(schema), Arc::new(properties))?;
        for start in (0..self.rows()).step_by(ROWS_PER_GROUP) {
            let rows = start..self.rows().min(start + ROWS_PER_GROUP);
            let mut group = file.next_row_group()?;
            for column in self.columns() {
                write(&mut group, column, rows.clone())?;
            }
            let _group = group.close()?;
        }
        let _footer = file.close()?;
        Ok(bytes)
    }
}

/// A column's place in the schema.
fn field(column: &Column) -> std::result::Result<Arc<Type>, ParquetError> {
    let (physical, logical) = match column.values {
        Values::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        Values::Unsigned(_) => (Physical::INT64, Some(LogicalType::integer(64, false))),
        Values::Signed(_) => (Physical::INT64, None),
        Values::Number(_) => (Physical::DOUBLE, None),
    };
    let field = Type::primitive_type_builder(&column.name, physical)
        .with_repetition(Repetition::OPTIONAL)
        .with_logical_type(logical);
    Ok(Arc::new(field.build()?))
}

/// Writes one column's rows as the next column of a row group.
fn write(
    group: &mut SerializedRowGroupWriter<'_, &mut Vec<u8>>,
    column: &Column,
    rows: Range<usize>,
) -> std::result::Result<(), ParquetError> {
    match &column.values {
        Values::Text(values) => {
            write_as::<ByteArrayType, _>(group, &values[rows], |text| ByteArray::from(text.as_str()))
        }
        Values::Unsigned(values) => {
            write_as::<Int64Type, _>(group, &values[rows], |value| value.cast_signed())
        }
        Values::Signed(values) => write_as::<Int64Type, _>(group, &values[rows], |value| *value),
        Values::Number(values) => write_as::<DoubleType, _>(group, &values[rows], |value| *value),
    }
}

/// Present values, with a definition level of 1 where there is one and 0 where it is missing.
fn write_as<D: DataType, V>(
    group: &mut SerializedRowGroupWriter<'_, &mut Vec<u8>>,
    values: &[Option<V>],
    convert: impl Fn(&V) -> D::T,
) -> std::result::Result<(), ParquetError> {
    let levels: Vec<i16> = values.iter().map(|value| i16::from(value.is_some())).collect();
    let present: Vec<D::T> = values.iter().flatten().map(convert).collect();
    let mut writer = group
        .next_column()?
        .ok_or_else(|| ParquetError::General("more columns than in the schema".to_owned()))?;
    let _written = writer.typed::<D>().write_batch(&present, Some(&levels), None)?;
    writer.close()
}
