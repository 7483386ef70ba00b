//! The `psrgs-vk` command.

fn main() {}
