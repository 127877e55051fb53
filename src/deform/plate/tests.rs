//! The plate in a body.
