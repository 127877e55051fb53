//! Loops over several columns at once, compiled for the machine's vector instructions.
//!
//! A kernel is written once; where the processor has AVX2 or AVX-512 with fused multiply-add, it runs as compiled for that.

/// A loop that is worth vector instructions. `FUSED`: whether a fused multiply-add is one instruction.
pub trait Kernel {
    /// Must be `#[inline(always)]`, so that it is compiled anew for each instruction set.
    fn run<const FUSED: bool>(self);
}

/// Runs the kernel with the best instructions that the processor has.
pub fn run(kernel: impl Kernel) {
    #[cfg(target_arch = "x86_64")]
    {
        let has_fused =
            std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma");
        if has_fused
            && std::arch::is_x86_feature_detected!("avx512f")
            && std::arch::is_x86_feature_detected!("avx512vl")
        {
            // SAFETY: the processor has the features that the function is compiled for.
            return unsafe { run_avx512(kernel) };
        }
        if has_fused {
            // SAFETY: the processor has the features that the function is compiled for.
            return unsafe { run_avx2(kernel) };
        }
    }
    kernel.run::<false>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx2,fma")]
fn run_avx512(kernel: impl Kernel) {
    kernel.run::<true>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2(kernel: impl Kernel) {
    kernel.run::<true>();
}

/// a b + c.
#[inline(always)]
pub fn fused<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// [`fused`] in f64.
#[inline(always)]
pub fn fused64<const FUSED: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// The `T` numbers from `at` on.
#[inline(always)]
pub fn lanes<const T: usize, N>(values: &[N], at: usize) -> &[N; T] {
    // A slice of this length always is such an array.
    values[at..].first_chunk().unwrap_or_else(|| unreachable!())
}

/// [`lanes`] to be written to.
#[inline(always)]
pub fn lanes_mut<const T: usize, N>(values: &mut [N], at: usize) -> &mut [N; T] {
    values[at..].first_chunk_mut().unwrap_or_else(|| unreachable!())
}

/// Columns are padded to a multiple of this.
pub const LANES: usize = 4;

/// `columns` with their padding.
pub fn padded(columns: usize) -> usize {
    columns.div_ceil(LANES) * LANES
}
