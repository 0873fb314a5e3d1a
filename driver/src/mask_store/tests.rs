use std::os::unix::fs::{MetadataExt, symlink};

use super::*;

/// Size of the masks here.
const SIZE: (u32, u32) = (16, 16);

/// Writes a file.
type Write = fn(&Path);

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Folder(tempfile::tempdir().unwrap())
    }

    fn store(&self) -> MaskStore {
        MaskStore::new(&self.0.path().join("left.png"))
    }

    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

/// A mask with `rows` rows blanked.
fn mask(rows: u32) -> Mask {
    Mask::from_fn(16, 16, |_, y| y < rows)
}

fn store(store: &MaskStore, rows: u32) {
    let (input, overlay) = (GrayImage::new(16, 16), image::RgbImage::new(16, 16));
    let provenance = [("Method", "test".to_owned())];
    let mask = mask(rows);
    let candidate = Candidate { mask: &mask, provenance: &provenance, input: &input, overlay: &overlay };
    store.store(&candidate).unwrap();
}

fn rows_in_force(store: &MaskStore) -> u64 {
    Mask::load(store.in_force()).unwrap().masked_px() / 16
}

#[test]
fn a_candidate_does_not_touch_the_mask_in_force() {
    let folder = Folder::new();
    mask(1).save(folder.store().in_force(), &[]).unwrap();
    store(&folder.store(), 2);
    assert_eq!(rows_in_force(&folder.store()), 1);
    assert_eq!(
        folder.names(),
        ["left.candidate.input.png", "left.candidate.overlay.png", "left.candidate.png", "left.png"]
    );
    folder.store().discard().unwrap();
    assert_eq!(folder.names(), ["left.png"]);
}

#[test]
fn accepting_keeps_the_last_five_and_they_can_be_restored() {
    let folder = Folder::new();
    for rows in 1..=8 {
        store(&folder.store(), rows);
        folder.store().accept(SIZE).unwrap();
    }
    assert_eq!(folder.names(), ["left.history", "left.png"]);
    let rows = |path: &PathBuf| Mask::load(path).unwrap().masked_px() / 16;
    assert_eq!(folder.store().history().unwrap().iter().map(rows).collect::<Vec<_>>(), [7, 6, 5, 4, 3]);

    folder.store().restore(2, SIZE).unwrap();
    assert_eq!(rows_in_force(&folder.store()), 6);
    assert_eq!(folder.store().history().unwrap().iter().map(rows).collect::<Vec<_>>(), [8, 7, 6, 5, 4]);
    assert!(file::read_texts(folder.store().in_force()).unwrap().contains(&("Method".into(), "test".into())));
}

#[test]
fn what_is_not_there_is_refused() {
    let folder = Folder::new();
    assert!(matches!(folder.store().accept(SIZE), Err(Error::Usage(_))));
    assert!(matches!(folder.store().restore(1, SIZE), Err(Error::Usage(_))));
    assert!(matches!(folder.store().restore(0, SIZE), Err(Error::Usage(_))));
    folder.store().discard().unwrap();
}

/// The rows that each mask of the history blanks, the newest first.
fn rows_in_history(store: &MaskStore) -> Vec<u64> {
    let rows = |path: &PathBuf| Mask::load(path).unwrap().masked_px() / 16;
    store.history().unwrap().iter().map(rows).collect()
}

/// The folder's files with their content, history included.
fn everything(store: &MaskStore) -> Vec<(PathBuf, Vec<u8>)> {
    let folders = [store.in_force().parent().unwrap().to_owned(), store.history_folder()];
    let entries = folders.iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten();
    let mut files: Vec<_> =
        entries.map(|entry| entry.unwrap().path()).filter(|path| path.is_file()).collect();
    files.sort();
    files.into_iter().map(|path| (path.clone(), fs::read(&path).unwrap())).collect()
}

#[test]
fn a_candidate_that_must_not_fly_is_refused_before_anything_moves() {
    let folder = Folder::new();
    let left = folder.store();
    mask(1).save(left.in_force(), &[]).unwrap();
    store(&left, 2);
    left.accept(SIZE).unwrap();
    let wrong: [(&str, Write); 6] = [
        ("grey pixels: 224", |path| {
            GrayImage::from_fn(16, 16, |x, _| [(x * 17) as u8].into()).save(path).unwrap()
        }),
        ("the mask is 8x16 pixels, the frames are 16x16", |path| {
            Mask::from_fn(8, 16, |_, y| y < 3).save(path, &[]).unwrap();
        }),
        ("all pixels are masked", |path| mask(16).save(path, &[]).unwrap()),
        ("256 transparent pixels; flatten the picture: black is discarded, white kept", |path| {
            image::RgbaImage::from_pixel(16, 16, image::Rgba([255, 255, 255, 254])).save(path).unwrap();
        }),
        ("it does not begin as a PNG file does", |path| fs::write(path, "no picture").unwrap()),
        ("it is a folder, not a file", |path| fs::create_dir(path).unwrap()),
    ];
    for (expected, write) in wrong {
        store(&left, 3);
        fs::remove_file(left.candidate()).unwrap();
        write(&left.candidate());
        let before = everything(&left);
        let error = left.accept(SIZE).unwrap_err();
        assert_eq!(error.exit(), crate::exit::Exit::Refused, "{error}");
        let said = crate::causes::with_causes(&error);
        assert!(said.contains(expected), "{said}");
        assert_eq!(everything(&left), before, "{expected}");
        let _ = fs::remove_dir(left.candidate());

        // The same in the history.
        let bad = left.history_folder().join("000009_bad.png");
        write(&bad);
        let before = everything(&left);
        assert_eq!(left.restore(1, SIZE).unwrap_err().exit(), crate::exit::Exit::Refused);
        assert_eq!(everything(&left), before, "{expected}");
        fs::remove_file(&bad).or_else(|_| fs::remove_dir(&bad)).unwrap();
    }
}

#[test]
fn the_history_is_ordered_by_what_grows_and_not_by_the_clock() {
    let folder = Folder::new();
    let left = folder.store();
    mask(9).save(left.in_force(), &[]).unwrap();
    // Earlier versions named them by the time alone, here one that a clock in the future gave.
    fs::create_dir(left.history_folder()).unwrap();
    for (rows, name) in [(1, "2026-01-01T00-00-00.000000000Z.png"), (2, "2099-01-01T00-00-00.000000000Z.png")]
    {
        mask(rows).save(&left.history_folder().join(name), &[]).unwrap();
    }
    mask(3).save(&left.history_folder().join("000041_2099-01-01T00-00-00.000000000Z.png"), &[]).unwrap();
    // No number that was counted here.
    mask(4).save(&left.history_folder().join("99999999999999999999_.png"), &[]).unwrap();
    store(&left, 10);
    left.accept(SIZE).unwrap();
    assert_eq!(rows_in_history(&left), [9, 3, 4, 2, 1]);
    let newest = left.history().unwrap().remove(0);
    assert!(newest.file_name().unwrap().to_str().unwrap().starts_with("000042_2"), "{newest:?}");
    // What was just kept stays, the oldest goes.
    store(&left, 11);
    left.accept(SIZE).unwrap();
    assert_eq!(rows_in_history(&left), [10, 9, 3, 4, 2]);
    left.restore(1, SIZE).unwrap();
    assert_eq!((rows_in_force(&left), rows_in_history(&left)), (10, vec![11, 10, 9, 3, 4]));
}

#[test]
fn no_two_files_share_their_content() {
    let folder = Folder::new();
    let left = folder.store();
    mask(1).save(left.in_force(), &[]).unwrap();
    store(&left, 2);
    left.accept(SIZE).unwrap();
    left.restore(1, SIZE).unwrap();
    for (path, _) in everything(&left) {
        assert_eq!(fs::metadata(&path).unwrap().nlink(), 1, "{path:?}");
    }
    // An editor writes into the file that is there.
    fs::write(left.in_force(), fs::read(&left.history().unwrap()[0]).unwrap()).unwrap();
    assert_eq!((rows_in_force(&left), rows_in_history(&left)), (2, vec![2, 1]));
}

#[test]
fn where_the_mask_is_a_link_the_file_behind_it_is_kept_and_replaced() {
    let folder = Folder::new();
    let left = folder.store();
    fs::create_dir(folder.0.path().join("data")).unwrap();
    let data = folder.0.path().join("data/v1.png");
    symlink("data/link.png", left.in_force()).unwrap();
    symlink("v1.png", folder.0.path().join("data/link.png")).unwrap();
    // The links may be there first.
    store(&left, 1);
    left.accept(SIZE).unwrap();
    assert_eq!((rows_in_force(&left), rows_in_history(&left)), (1, vec![]));
    store(&left, 2);
    left.accept(SIZE).unwrap();
    assert!(left.in_force().is_symlink());
    assert_eq!(Mask::load(&data).unwrap(), mask(2));
    mask(7).save(&data, &[]).unwrap();
    assert_eq!(rows_in_history(&left), [1], "the content, not the link");
    left.restore(1, SIZE).unwrap();
    assert_eq!((Mask::load(&data).unwrap(), rows_in_history(&left)), (mask(1), vec![7, 1]));

    fs::remove_file(left.in_force()).unwrap();
    symlink("left.png", left.in_force()).unwrap();
    let error = left.restore(1, SIZE).unwrap_err();
    assert!(crate::causes::with_causes(&error).contains("it leads to itself"), "{error}");
}

#[test]
fn where_a_file_cannot_be_written_everything_stays() {
    let folder = Folder::new();
    let left = folder.store();
    // The history cannot be a folder.
    mask(1).save(left.in_force(), &[]).unwrap();
    fs::write(left.history_folder(), "").unwrap();
    store(&left, 2);
    let before = everything(&left);
    assert!(left.accept(SIZE).is_err());
    assert_eq!(everything(&left), before);
    fs::remove_file(left.history_folder()).unwrap();

    // The history can be written, the mask cannot: nobody makes files in /proc.
    fs::remove_file(left.in_force()).unwrap();
    symlink("/proc/version", left.in_force()).unwrap();
    let before = everything(&left);
    let said = crate::causes::with_causes(&left.accept(SIZE).unwrap_err());
    assert!(said.contains("cannot write `/proc/version`"), "{said}");
    assert_eq!(everything(&left), before);
}

#[test]
fn what_is_in_force_and_no_file_is_left_alone() {
    let folder = Folder::new();
    let left = folder.store();
    fs::create_dir(left.in_force()).unwrap();
    store(&left, 1);
    let error = left.accept(SIZE).unwrap_err();
    assert!(crate::causes::with_causes(&error).contains("it is a folder, not a file"), "{error}");
    assert!(left.candidate().exists());
}

#[test]
fn masks_without_png_in_their_names_have_candidates_of_their_own() {
    let candidate = |name: &str| MaskStore::new(Path::new(name)).candidate();
    for (name, expected) in [
        ("masks/left.png", "masks/left.candidate.png"),
        ("LEFT.PNG", "LEFT.candidate.png"),
        ("front.left", "front.left.candidate.png"),
        ("front.right", "front.right.candidate.png"),
        ("front.left.png", "front.left.candidate.png"),
        ("left", "left.candidate.png"),
    ] {
        assert_eq!(candidate(name), Path::new(expected));
    }
    assert_eq!(MaskStore::new(Path::new("front.left")).history_folder(), Path::new("front.left.history"));
}

#[test]
fn what_root_accepts_belongs_to_the_owner_of_the_folder() {
    const OWNER: u32 = 65534;
    let folder = Folder::new();
    let left = folder.store();
    assert_eq!(
        fs::metadata(folder.0.path()).unwrap().uid(),
        0,
        "only root acts for others: run this as root"
    );
    std::os::unix::fs::chown(folder.0.path(), Some(OWNER), Some(OWNER)).unwrap();
    for rows in 1..4 {
        store(&left, rows);
        assert_eq!(fs::metadata(left.candidate()).unwrap().uid(), OWNER);
        left.accept(SIZE).unwrap();
    }
    left.restore(1, SIZE).unwrap();
    let owner = |path: &Path| fs::metadata(path).map(|metadata| (metadata.uid(), metadata.gid())).unwrap();
    assert_eq!(owner(&left.history_folder()), (OWNER, OWNER));
    let files = everything(&left);
    assert_eq!(files.len(), 4);
    for (path, _) in files {
        assert_eq!(owner(&path), (OWNER, OWNER), "{path:?}");
    }
}

#[test]
fn a_mask_keeps_its_mode_and_owner_when_it_is_replaced() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new();
    let left = folder.store();
    mask(1).save(left.in_force(), &[]).unwrap();
    fs::set_permissions(left.in_force(), fs::Permissions::from_mode(0o640)).unwrap();
    store(&left, 2);
    left.accept(SIZE).unwrap();
    assert_eq!(fs::metadata(left.in_force()).unwrap().mode() & 0o777, 0o640);
}
