//! What is kept on disk: files that appear whole or not at all, the cache, and the checkpoints of
//! long work.
//!
//! Knows nothing of what is stored.

mod atomic;
pub mod cache;
mod checkpoint;
mod disk;
mod kind;
mod lock;
pub mod memory;
pub mod npy;
mod npz;
mod seal;
mod spool;
#[cfg(test)]
pub(crate) mod test_forgeries;

pub use atomic::{
    NewFile, TEMPORARY, advice, put_back, write_file, write_file_durably, write_folder,
};
pub(crate) use checkpoint::take_chains;
pub use checkpoint::{Checkpoint, CheckpointError, Identity, differences};
pub use checkpoint::{Keeper, take_chain};
pub use disk::free_on_disk;
pub use kind::Kind;
pub use lock::{FolderLock, LockError};
pub(crate) use npz::MOST_INFLATED;
pub use npz::{NpzReader, NpzWriter, Packing, array_name};
pub use seal::{is_name, seal_of, seals, unchanged};
pub use spool::Spool;
