//! Every model that ships is read.

#[test]
fn t() {
    for file in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../models")).unwrap() {
        let path = file.unwrap().path();
        if path.extension().is_some_and(|e| e == "rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            let file = eplat_language::File::read(&text);
            if let Err(m) = file {
                panic!("{}", m.show(path.to_str().unwrap(), &text));
            }
        }
    }
    let mut files: Vec<_> =
        std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/mistakes"))
            .unwrap()
            .map(|e| e.unwrap().path())
            .collect();
    files.sort();
    for path in files {
        let text = std::fs::read_to_string(&path).unwrap();
        match eplat_language::File::read(&text) {
            Err(m) => println!("{}\n", m.show(path.file_name().unwrap().to_str().unwrap(), &text)),
            Ok(_) => println!("{}: fine\n", path.file_name().unwrap().to_str().unwrap()),
        }
    }
}
