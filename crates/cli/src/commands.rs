//! One module per command.

pub mod dose;
pub mod explain;
pub mod export;
pub mod layout;
pub mod models;
pub mod new;
pub mod replay;
pub mod reproduce;
pub mod run;
pub mod scenarios;
pub mod trials;
pub mod view;
