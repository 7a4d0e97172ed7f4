//! What `compare` found: on the screen, and as a page.

mod maps;
mod page;
mod rays;
mod text;

pub(crate) use page::page;
pub(crate) use text::text;
