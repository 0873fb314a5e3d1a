//! Paths and the address of shared memory.

use super::*;

#[test]
fn the_word_none_is_written_small() {
    for word in ["None", "NONE", " none", "off", "no", "False", "null"] {
        let message = refusal("masks/left.png", word);
        assert!(
            message.contains(&format!(
                "uvcam.toml:9: mask: found {word:?}; write \"none\" to fly without a mask"
            )),
            "{message}"
        );
    }
    let file = parse(&CAMERA.replace("masks/left.png", "./None")).unwrap();
    assert_eq!(file.cameras[0].mask, MaskChoice::File("/etc/uvcam/./None".into()));
}

#[test]
fn only_names_stand_in_braces() {
    for template in ["{name}.png", "{UAV}_{serial}.png"] {
        let message = refusal("masks/left.png", template);
        assert!(
            message.contains("write {uav}, {serial} or {camera}: only these stand for names"),
            "{message}"
        );
    }
}

#[test]
fn what_a_shell_would_expand_is_refused() {
    let source = "kind = \"aravis\", serial = \"25003774\"";
    let path_of = |kind: &str, path: &str| refusal(source, &format!("kind = \"{kind}\", path = \"{path}\""));
    let root_path = |path: &str| refusal("[[camera]]", &format!("[ipc]\nroot_path = \"{path}\"\n[[camera]]"));
    for (path, cause) in [
        ("~/frames", "~ is not expanded"),
        ("~mrs/frames", "~ is not expanded"),
        ("$HOME/frames", "variables are not expanded"),
    ] {
        let expected = format!("found \"{path}\"; {cause}: write the folders out, from / on");
        for (message, key) in [
            (refusal("masks/left.png", path), "uvcam.toml:9: mask: "),
            (path_of("replay", path), "uvcam.toml:4: path: "),
            (path_of("v4l2", path), "uvcam.toml:4: path: "),
            (root_path(path), "uvcam.toml:3: root_path: "),
        ] {
            assert!(message.contains(&format!("{key}{expected}")), "{message}");
        }
    }
    assert!(path_of("replay", "").contains("path: found an empty text; allowed: a folder of PNG files"));
    assert!(path_of("v4l2", "a\\u0000").contains("path: found \"a\\0\"; allowed: a path without control"));
}

#[test]
fn an_address_that_shared_memory_refuses_is_refused_when_read() {
    let refused = |lines: &str| refusal("[[camera]]", &format!("[ipc]\n{lines}\n[[camera]]"));
    let only = "allowed: only ASCII letters, digits and signs other than < > \" | ? * in root_path";
    let long = "an absolute path of at most 60 bytes together with prefix";
    for (lines, expected) in [
        ("root_path = \"/tmp/žluťoučký\"", format!("uvcam.toml:3: root_path: found /tmp/žluťoučký; {only}")),
        ("root_path = \"/tmp/a*b\"", format!("root_path: found /tmp/a*b; {only}")),
        (&format!("root_path = \"/{}\"", "x".repeat(60)), format!("allowed: {long}")),
        ("root_path = \"\"", "root_path: found an empty text; allowed: an absolute path".into()),
        ("prefix = \"a b\"", "uvcam.toml:3: prefix: found \"a b\"; allowed: 1 to 32 letters, digits".into()),
        ("max_subscribers = 65", "uvcam.toml:3: max_subscribers: found 65; allowed: 1 to 64".into()),
        ("borrowed = 0", "uvcam.toml:3: borrowed: found 0; allowed: 1 to 64 frames".into()),
        ("slots = 1", "uvcam.toml:3: slots: found 1; allowed: 2 to 64".into()),
    ] {
        let message = refused(lines);
        assert!(message.contains(&expected), "{message}\n{expected}");
    }
    // Whichever key is too long with the other, the line is one that is there.
    let root_path = format!("/{}", "x".repeat(50));
    let message = refused(&format!("prefix = \"twelve_chars\"\nroot_path = \"{root_path}\""));
    assert!(message.contains("uvcam.toml:4: root_path: found /x") && message.contains(long), "{message}");
}
