//! Files that are no text, or no files.

use std::io::Write;

use super::*;

fn refusal_of(bytes: &[u8]) -> String {
    Config::from_bytes(bytes, Path::new("/etc/uvcam/uvcam.toml")).unwrap_err().to_string()
}

#[test]
fn another_encoding_is_named_with_line_and_byte() {
    let latin1 = [CAMERA.as_bytes(), b"# 40 \xb0C\n"].concat();
    assert_eq!(refusal_of(&latin1), "/etc/uvcam/uvcam.toml:10: not UTF-8 (byte 0xb0); save it as UTF-8");
    for (mark, shown, bytes_of) in [
        (&[0xff, 0xfe], "ff fe", u16::to_le_bytes as fn(u16) -> [u8; 2]),
        (&[0xfe, 0xff], "fe ff", u16::to_be_bytes),
    ] {
        let text: Vec<u8> = CAMERA.trim_start().encode_utf16().flat_map(bytes_of).collect();
        let expected = format!("uvcam.toml:1: UTF-16, as it begins with {shown}; save it as UTF-8");
        assert!(refusal_of(&[mark.as_slice(), &text].concat()).contains(&expected));
        let message = refusal_of(&text);
        assert!(message.contains("uvcam.toml:1: not UTF-8 text (byte 0x00, as in UTF-16)"), "{message}");
    }
}

#[test]
fn a_mark_of_utf_8_is_accepted_and_counts_for_the_digest() {
    let marked = format!("\u{feff}{CAMERA}");
    let config = Config::from_bytes(marked.as_bytes(), Path::new("uvcam.toml")).unwrap();
    assert_eq!(config.cameras, Config::parse(CAMERA, Path::new("uvcam.toml")).unwrap().cameras);
    assert_eq!(config.digest, Sha256::digest(&marked)[..16]);
}

#[test]
fn only_regular_files_of_a_bounded_length_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |path: &Path| Config::load(Some(path)).unwrap_err().to_string();
    let allowed = "; --config names a text file of at most 1 MB";
    assert!(refused(folder.path()).ends_with(&format!(": found a folder{allowed}")));
    assert!(refused(Path::new("/dev/zero")).ends_with(&format!(": found a device{allowed}")));
    let pipe = folder.path().join("pipe");
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR).unwrap();
    assert!(refused(&pipe).ends_with(&format!("pipe: found a pipe{allowed}")));
    let socket = folder.path().join("socket");
    let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
    assert!(refused(&socket).ends_with(&format!("socket: found a socket{allowed}")));
    let long = folder.path().join("long.toml");
    std::fs::File::create(&long).unwrap().write_all(&vec![b'\n'; (1 << 20) + 1]).unwrap();
    assert!(refused(&long).ends_with(&format!("long.toml: found more than 1 MB{allowed}")));
}

#[test]
fn an_empty_file_has_no_camera() {
    let message = refusal_of(b"");
    assert!(
        message.contains("uvcam.toml:1: camera: found no [[camera]] table; allowed: at least one camera")
    );
}
