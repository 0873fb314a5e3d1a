//! How the library is linked.

fn main() {
    // The name by which programs that were linked with it find it again. Before 1.0, each minor version may change the interface.
    let name = match (env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR")) {
        ("0", minor) => format!("libuvcam.so.0.{minor}"),
        (major, _) => format!("libuvcam.so.{major}"),
    };
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,{name}");
    // iceoryx2 exports its logger: the one of another library in the same program is not for this one.
    println!("cargo::rustc-cdylib-link-arg=-Wl,-Bsymbolic");
    println!("cargo::rerun-if-changed=build.rs");
}
