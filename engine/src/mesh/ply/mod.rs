//! Stanford's polygon format, .ply: text or bytes in either order, read and written.
//!
//! Numbers of a vertex beyond x, y and z, and numbers of a face, are data.

mod header;
mod read;
mod write;

pub(super) use read::parse;
pub(super) use write::written;
