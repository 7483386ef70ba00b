//! The `psrgs-vk` command.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
