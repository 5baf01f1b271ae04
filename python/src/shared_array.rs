//! Memory that the simulator writes and numpy reads: the one place with `unsafe`.
//!
//! A [`Memory`] object owns the bytes, and every numpy view has it as its base: the bytes live until the last of environment
//! and views is gone, and nothing ever moves them. Views are read-only for Python. Rust writes through [`SharedArray::values_mut`],
//! which needs the array for itself, so Rust never reads while it writes; a Python thread that reads a view while another
//! thread steps finds a mixture of two slots, as with any numpy array that is written meanwhile.

#![expect(unsafe_code, reason = "numpy views onto memory that Rust writes")]

use numpy::ndarray::{ArrayView, IntoDimension};
use numpy::{Element, PyArray, PyArrayMethods};
use pyo3::prelude::*;
use std::alloc::{Layout, alloc_zeroed, dealloc, handle_alloc_error};
use std::ptr::NonNull;

/// Alignment of every array: a cache line, which is enough for every vector instruction.
const ALIGNMENT: usize = 64;

/// Numbers of which all bytes zero is a value.
pub trait Plain: Element + Copy + Send + Sync {}
impl Plain for i8 {}
impl Plain for u8 {}
impl Plain for i16 {}
impl Plain for u16 {}
impl Plain for u32 {}
impl Plain for bool {}
impl Plain for f32 {}

/// Owner of an array's bytes.
#[pyclass(frozen)]
struct Memory {
    start: NonNull<u8>,
    layout: Layout,
}

// SAFETY: a `Memory` only frees its bytes; it never reads or writes them.
unsafe impl Send for Memory {}
// SAFETY: as above.
unsafe impl Sync for Memory {}

impl Memory {
    /// Bytes that are all zero.
    fn zeros(layout: Layout) -> Self {
        // SAFETY: the layout has at least one byte: `SharedArray::zeros` sees to it.
        let start = unsafe { alloc_zeroed(layout) };
        match NonNull::new(start) {
            Some(start) => Self { start, layout },
            None => handle_alloc_error(layout),
        }
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        // SAFETY: allocated in `zeros` with the same layout, and freed once.
        unsafe { dealloc(self.start.as_ptr(), self.layout) }
    }
}

/// An array of fixed length with its numpy view.
pub struct SharedArray<T> {
    start: NonNull<T>,
    length: usize,
    /// A numpy array whose base is the [`Memory`].
    view: Py<PyAny>,
}

// SAFETY: the values are plain numbers in memory that the view keeps alive; `&mut` guards Rust's writes.
unsafe impl<T: Plain> Send for SharedArray<T> {}
// SAFETY: as above.
unsafe impl<T: Plain> Sync for SharedArray<T> {}

impl<T: Plain> SharedArray<T> {
    /// Zeros of this shape, in C order.
    ///
    /// # Errors
    /// `MemoryError` where numpy cannot make a view, `ValueError` for a size beyond the address space.
    pub fn zeros<D: IntoDimension>(py: Python<'_>, shape: D) -> PyResult<Self> {
        let shape = shape.into_dimension();
        let length = numpy::ndarray::Dimension::size(&shape);
        let layout = Layout::array::<T>(length.max(1)).and_then(|layout| layout.align_to(ALIGNMENT));
        let layout = layout
            .map_err(|error| crate::error::value_error("worlds", error, "arrays that fit the memory"))?;
        let memory = Memory::zeros(layout);
        let start = memory.start.cast::<T>();
        let memory = Bound::new(py, memory)?;
        // SAFETY: `start` points to `length` zeroed values of `T`, for which zero bytes are a value, aligned for it; the
        // memory is the base of the numpy array, so it outlives it, and is never reallocated.
        let view = unsafe {
            let values = ArrayView::from_shape_ptr(shape, start.as_ptr());
            PyArray::borrow_from_array(&values, memory.into_any())
        };
        let _ = view.readwrite().make_nonwriteable();
        let view = view.into_any().unbind();
        Ok(Self { start, length, view })
    }

    /// The same values in memory of their own.
    ///
    /// # Errors
    /// As [`SharedArray::zeros`].
    pub fn copy(&mut self, py: Python<'_>) -> PyResult<Self> {
        let shape = self.view.bind(py).getattr("shape")?;
        let mut copy = Self::zeros(py, shape.extract::<Vec<usize>>()?)?;
        copy.values_mut().copy_from_slice(self.values_mut());
        Ok(copy)
    }

    /// The numpy array.
    pub fn view(&self, py: Python<'_>) -> Py<PyAny> {
        self.view.clone_ref(py)
    }

    /// The values.
    pub fn values_mut(&mut self) -> &mut [T] {
        // SAFETY: `length` values that `view` keeps alive. Rust has no other way to them than through `self`; Python only
        // reads, outside of Rust's memory model.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr(), self.length) }
    }
}
