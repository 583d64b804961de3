//! Whole-system tests of Relume live in `tests/tests`.
