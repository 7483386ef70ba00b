//! Starts a page in the browser and says where.

use psrgs_vk::view::{Address, SceneInfo, Server};

use super::console::{self, Console};
use super::exit::Failure;

/// Where a page listens if no address is named, as the default of an option.
pub(crate) const ADDRESS: &str = "127.0.0.1";

/// Starts a page about a scene and prints its address, also where little is printed: nobody could open it otherwise.
pub(crate) fn start(address: &Address, scene: SceneInfo, console: &Console) -> anyhow::Result<Server> {
    let server = Server::start(address, scene).map_err(|error| Failure::Usage(error.to_string()))?;
    if !address.is_loopback() {
        console.warn(format_args!(
            "the page is served to other machines over HTTP, which is not encrypted: whoever reads the connection can use \
             the page. An ssh tunnel to a page on this machine alone is safe"
        ));
    }
    console::print(&format!("page: {}\n", server.url()))?;
    Ok(server)
}
