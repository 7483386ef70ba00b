//! Catches panics of decoders in other crates: some assert properties that damaged data lacks.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The result of a decoder, or its message if it panics. Do not use the decoder's data after a panic.
pub(crate) fn contained<T>(decode: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(decode)).map_err(|cause| said(cause.as_ref()))
}

fn said(cause: &(dyn Any + Send)) -> String {
    let text = cause.downcast_ref::<String>().map(String::as_str).or_else(|| cause.downcast_ref::<&str>().copied());
    format!("the decoder gave up on it: {}", text.unwrap_or("the data is damaged"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_words_and_anything_else_passes() {
        assert_eq!(contained(|| 7), Ok(7));
        let problem = contained(|| assert_eq!(1 + contained(|| 1).unwrap_or(0), 3, "no sum")).expect_err("a panic");
        assert!(problem.contains("gave up") && problem.contains("no sum"), "{problem}");
    }
}
