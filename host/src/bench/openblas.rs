//! OpenBLAS, loaded at run time: the rival needs no build-time dependency and may be absent.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char, c_int};

use libloading::Library;

/// Environment variable that names the one library file to try instead of the usual ones.
pub const LIBRARY_VARIABLE: &str = "RELUME_OPENBLAS";

const USUAL_NAMES: [&str; 3] = ["libopenblas.so.0", "libopenblas.so", "libblas.so.3"];
const ROW_MAJOR: c_int = 101;
const COL_MAJOR: c_int = 102;
const NO_TRANS: c_int = 111;
const TRANS: c_int = 112;
const UPPER: c_int = 121;

/// `cblas_sgemv(order, trans, m, n, alpha, a, lda, x, incx, beta, y, incy)` with 32-bit integers.
type Sgemv =
    unsafe extern "C" fn(c_int, c_int, c_int, c_int, f32, *const f32, c_int, *const f32, c_int, f32, *mut f32, c_int);

/// `cblas_saxpy(n, alpha, x, incx, y, incy)`.
type Saxpy = unsafe extern "C" fn(c_int, f32, *const f32, c_int, *mut f32, c_int);
/// `cblas_sgemm(order, transa, transb, m, n, k, alpha, a, lda, b, ldb, beta, c, ldc)`.
type Sgemm = unsafe extern "C" fn(
    c_int,
    c_int,
    c_int,
    c_int,
    c_int,
    c_int,
    f32,
    *const f32,
    c_int,
    *const f32,
    c_int,
    f32,
    *mut f32,
    c_int,
);
/// `cblas_dsyrk(order, uplo, trans, n, k, alpha, a, lda, beta, c, ldc)`.
type Dsyrk = unsafe extern "C" fn(c_int, c_int, c_int, c_int, c_int, f64, *const f64, c_int, f64, *mut f64, c_int);
/// LAPACK's `dsyevd_(jobz, uplo, n, a, lda, w, work, lwork, iwork, liwork, info)` and Fortran's two text lengths.
type Dsyevd = unsafe extern "C" fn(
    *const c_char,
    *const c_char,
    *const c_int,
    *mut f64,
    *const c_int,
    *mut f64,
    *mut f64,
    *const c_int,
    *mut c_int,
    *const c_int,
    *mut c_int,
    usize,
    usize,
);

/// Why OpenBLAS cannot be used here.
#[derive(Debug, thiserror::Error)]
pub enum BlasError {
    /// No library of the tried names could be loaded.
    #[error("no OpenBLAS found ({tried}); install libopenblas0-pthread or name the file in {LIBRARY_VARIABLE}")]
    Missing {
        /// The names that were tried.
        tried: String,
    },
    /// A BLAS was loaded, but not OpenBLAS with 32-bit integers.
    #[error("{file} is a BLAS but not OpenBLAS with 32-bit integers; install libopenblas0-pthread")]
    Foreign {
        /// The file's name.
        file: String,
    },
}

/// How a matrix lies in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The columns of a row lie side by side.
    RowMajor,
    /// The rows of a column lie side by side.
    ColMajor,
}

/// A loaded OpenBLAS, set to one thread; several threads may call it at a time.
pub struct Blas {
    sgemv: Sgemv,
    saxpy: Saxpy,
    sgemm: Sgemm,
    dsyrk: Dsyrk,
    dsyevd: Option<Dsyevd>,
    kernel: String,
    // Declared last: the function pointers above are valid while the library is loaded.
    _library: Library,
}

impl Blas {
    /// Loads OpenBLAS under its usual names, or the one that [`LIBRARY_VARIABLE`] names.
    ///
    /// # Errors
    /// [`BlasError`] if there is none, or only another BLAS.
    pub fn load() -> Result<Self, BlasError> {
        match std::env::var(LIBRARY_VARIABLE) {
            Ok(name) => Self::load_first(&[&name]),
            Err(_) => Self::load_first(&USUAL_NAMES),
        }
    }

    /// Loads the first of `names` that is OpenBLAS.
    ///
    /// # Errors
    /// [`BlasError::Missing`] if none can be loaded, [`BlasError::Foreign`] if what loads is another BLAS.
    pub fn load_first(names: &[&str]) -> Result<Self, BlasError> {
        let mut foreign = None;
        for name in names {
            // SAFETY: loading runs the library's initialisers; the names are those of the system's BLAS, or the
            // user's own choice, and OpenBLAS's initialisers only read the CPU's features and the environment.
            let Ok(library) = (unsafe { Library::new(name) }) else { continue };
            match Self::from_library(library) {
                Some(blas) => return Ok(blas),
                None => foreign = Some((*name).to_owned()),
            }
        }
        Err(match foreign {
            Some(file) => BlasError::Foreign { file },
            None => BlasError::Missing { tried: names.join(", ") },
        })
    }

    fn from_library(library: Library) -> Option<Self> {
        // SAFETY: the types are those of OpenBLAS's cblas.h. A build with 64-bit integers is turned away below, and
        // `library` outlives the copied pointers because `Blas` owns it.
        let (sgemv, saxpy, sgemm, dsyrk, dsyevd) = unsafe {
            (
                *library.get::<Sgemv>(b"cblas_sgemv\0").ok()?,
                *library.get::<Saxpy>(b"cblas_saxpy\0").ok()?,
                *library.get::<Sgemm>(b"cblas_sgemm\0").ok()?,
                *library.get::<Dsyrk>(b"cblas_dsyrk\0").ok()?,
                library.get::<Dsyevd>(b"dsyevd_\0").ok().map(|f| *f),
            )
        };
        // SAFETY: as above.
        let (set_threads, config, core) = unsafe {
            (
                *library.get::<unsafe extern "C" fn(c_int)>(b"openblas_set_num_threads\0").ok()?,
                *library.get::<unsafe extern "C" fn() -> *const c_char>(b"openblas_get_config\0").ok()?,
                library.get::<unsafe extern "C" fn() -> *const c_char>(b"openblas_get_corename\0").ok().map(|f| *f),
            )
        };
        // SAFETY: both return a static, NUL-terminated string; the thread count is a plain number.
        let (config, core) = unsafe {
            set_threads(1);
            (text(config()), core.map(|core| text(core())))
        };
        if config.contains("USE64BITINT") {
            return None;
        }
        let kernel = core.unwrap_or_else(|| config.clone());
        Some(Blas { sgemv, saxpy, sgemm, dsyrk, dsyevd, kernel, _library: library })
    }

    /// Name of the kernel that OpenBLAS chose for this CPU (or its build text, where it cannot tell).
    pub fn kernel(&self) -> &str {
        &self.kernel
    }

    /// `y = A x` with `A` of `y.len()` rows and `x.len()` columns, packed without gaps.
    ///
    /// Does nothing if the lengths do not agree or do not fit a 32-bit integer: see [`Blas::fits`].
    pub fn sgemv(&self, order: Order, a: &[f32], x: &[f32], y: &mut [f32]) {
        let (rows, cols) = (y.len(), x.len());
        debug_assert!(Self::fits(rows, cols) && a.len() == rows * cols);
        if !Self::fits(rows, cols) || a.len() != rows * cols {
            return;
        }
        let (order, lda) = match order {
            Order::RowMajor => (ROW_MAJOR, cols as c_int),
            Order::ColMajor => (COL_MAJOR, rows as c_int),
        };
        // SAFETY: `a` holds rows x cols values at leading dimension `lda`, `x` and `y` are as long as stated with
        // stride 1, all dimensions are positive and fit c_int, and `y` does not alias the others (it is `&mut`).
        unsafe {
            (self.sgemv)(
                order,
                NO_TRANS,
                rows as c_int,
                cols as c_int,
                1.0,
                a.as_ptr(),
                lda,
                x.as_ptr(),
                1,
                0.0,
                y.as_mut_ptr(),
                1,
            );
        }
    }

    /// `y += a x`. Does nothing if the lengths differ or do not fit a 32-bit integer.
    pub fn saxpy(&self, a: f32, x: &[f32], y: &mut [f32]) {
        if x.len() == y.len() && Self::fits(x.len(), 1) {
            // SAFETY: both hold as many values as stated, stride 1, and `y` is borrowed alone.
            unsafe { (self.saxpy)(x.len() as c_int, a, x.as_ptr(), 1, y.as_mut_ptr(), 1) }
        }
    }

    /// `C = A B`, all by columns without gaps: A is `m x k`, B is `k x n`. Does nothing if the lengths do not agree.
    pub fn sgemm(&self, a: &[f32], b: &[f32], c: &mut [f32], [m, n, k]: [usize; 3]) {
        let fits = Self::fits(m, n) && Self::fits(m, k);
        if !fits || a.len() != m * k || b.len() != k * n || c.len() != m * n {
            return;
        }
        let [m, n, k] = [m, n, k].map(|side| side as c_int);
        let (a, b, c) = (a.as_ptr(), b.as_ptr(), c.as_mut_ptr());
        // SAFETY: the lengths were checked above, the sides are positive and fit, and `c` is borrowed alone.
        unsafe { (self.sgemm)(COL_MAJOR, NO_TRANS, NO_TRANS, m, n, k, 1.0, a, m, b, k, 0.0, c, m) }
    }

    /// Adds `A^T A` to the upper half of `gram` (`n x n` by columns); A is `k x n` by columns. Does nothing if the lengths
    /// do not agree.
    pub fn add_gram(&self, a: &[f64], k: usize, n: usize, gram: &mut [f64]) {
        if !Self::fits(k, n) || a.len() != k * n || gram.len() != n * n {
            return;
        }
        let (k, n) = (k as c_int, n as c_int);
        // SAFETY: as in `sgemm`.
        unsafe { (self.dsyrk)(COL_MAJOR, UPPER, TRANS, n, k, 1.0, a.as_ptr(), k, 1.0, gram.as_mut_ptr(), n) }
    }

    /// Replaces a symmetric `n x n` matrix, given by its upper half, by its eigenvectors, one per column, eigenvalues
    /// ascending.
    ///
    /// # Errors
    /// When this OpenBLAS was built without LAPACK, or it finds no solution.
    pub fn eigenvectors(&self, matrix: &mut [f64], n: usize) -> anyhow::Result<()> {
        let solve = self.dsyevd.ok_or_else(|| anyhow::anyhow!("this OpenBLAS has no dsyevd"))?;
        anyhow::ensure!(Self::fits(n, n) && n < 1 << 13 && matrix.len() == n * n, "no matrix of {n} x {n}");
        // The sizes of workspace that LAPACK asks for with eigenvectors.
        let (work_len, iwork_len) = (1 + 6 * n + 2 * n * n, 3 + 5 * n);
        let (mut values, mut work, mut iwork) = (vec![0.0f64; n], vec![0.0f64; work_len], vec![0 as c_int; iwork_len]);
        let (n, work_len, iwork_len, mut info) = (n as c_int, work_len as c_int, iwork_len as c_int, 0 as c_int);
        // SAFETY: the matrix is n x n, the workspaces are as long as LAPACK's documentation of dsyevd asks, the texts are
        // NUL-terminated and of length 1, and nothing aliases.
        unsafe {
            let (vectors, upper) = (c"V".as_ptr(), c"U".as_ptr());
            let (values, work, iwork) = (values.as_mut_ptr(), work.as_mut_ptr(), iwork.as_mut_ptr());
            let matrix = matrix.as_mut_ptr();
            solve(vectors, upper, &n, matrix, &n, values, work, &work_len, iwork, &iwork_len, &mut info, 1, 1);
        }
        anyhow::ensure!(info == 0, "dsyevd finds no solution ({info})");
        Ok(())
    }

    /// Whether [`Blas::sgemv`] takes a matrix of this size: at least 1x1, both sides within a 32-bit integer.
    pub fn fits(rows: usize, cols: usize) -> bool {
        (1..=c_int::MAX as usize).contains(&rows) && (1..=c_int::MAX as usize).contains(&cols)
    }
}

/// # Safety
/// `pointer` is null or points to a NUL-terminated string that is not changed meanwhile.
unsafe fn text(pointer: *const c_char) -> String {
    if pointer.is_null() {
        return "unknown".to_owned();
    }
    // SAFETY: not null, and NUL-terminated by this function's own contract.
    unsafe { CStr::from_ptr(pointer) }.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_library_is_named() {
        let error = Blas::load_first(&["no-such-blas.so"]).err().unwrap().to_string();
        assert!(error.contains("no-such-blas.so") && error.contains("libopenblas0-pthread"), "{error}");
    }

    #[test]
    fn another_library_is_not_taken_for_openblas() {
        let Err(error) = Blas::load_first(&["libm.so.6"]) else { panic!("libm is no BLAS") };
        assert!(matches!(error, BlasError::Foreign { .. } | BlasError::Missing { .. }));
    }

    #[test]
    fn both_orders_multiply() {
        let Ok(blas) = Blas::load() else { return eprintln!("skipped: no OpenBLAS here") };
        let mut y = [9.0; 2];
        blas.sgemv(Order::RowMajor, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[1.0, 10.0, 100.0], &mut y);
        assert_eq!(y, [321.0, 654.0]);
        blas.sgemv(Order::ColMajor, &[1.0, 4.0, 2.0, 5.0, 3.0, 6.0], &[1.0, 10.0, 100.0], &mut y);
        assert_eq!(y, [321.0, 654.0]);
        blas.saxpy(-2.0, &[1.0, 0.5], &mut y);
        assert_eq!(y, [319.0, 653.0]);
        let mut c = [0.0; 4];
        blas.sgemm(&[1.0, 4.0, 2.0, 5.0, 3.0, 6.0], &[1.0, 10.0, 100.0, 1.0, 0.0, 0.0], &mut c, [2, 2, 3]);
        assert_eq!(c, [321.0, 654.0, 1.0, 4.0]);
    }

    #[test]
    fn eigenvectors_of_a_gram_matrix_by_hand() {
        let Ok(blas) = Blas::load() else { return eprintln!("skipped: no OpenBLAS here") };
        // Columns (2, 0) and (1, 1) once, then nothing: A^T A = [[4, 2], [2, 2]], eigenvalues 3 -+ sqrt 5.
        let mut gram = [0.0; 4];
        blas.add_gram(&[2.0, 0.0, 1.0, 1.0], 2, 2, &mut gram);
        assert_eq!((gram[0], gram[2], gram[3]), (4.0, 2.0, 2.0));
        blas.eigenvectors(&mut gram, 2).unwrap();
        let slope = gram[3] / gram[2];
        assert!((slope - (5f64.sqrt() - 1.0) / 2.0).abs() < 1e-12, "{gram:?}");
    }
}
