//! Installing networks from a local server that has files as public servers have them.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use zip::write::SimpleFileOptions;

use super::super::{
    Added, Catalogue, CatalogueEntry, Dialect, InstallOptions, NnError, Runtime, TestResult, add,
    addresses, check, install, list, load_with_dialect, record_test, remove,
};
use super::server::{Server, digest, public};

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn zip(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, content) in files {
        zip.start_file(*name, SimpleFileOptions::default()).unwrap();
        zip.write_all(content).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// Writes an entry of one file.
fn entry_of(file: &str) -> Catalogue {
    let text = format!(
        "[[entry]]\nname = 'net'\npurpose = 'p'\nlicence = 'MIT'\nsource = 'https://s'\n{file}"
    );
    Catalogue::parse(&text).unwrap()
}

fn install_with(
    catalogue: &Catalogue,
    folder: &Path,
    options: &InstallOptions,
) -> Result<Vec<Added>, NnError> {
    install(catalogue, folder, "net", options, &mut |_| true)
}

fn install_net(catalogue: &Catalogue, folder: &Path) -> Result<Vec<Added>, NnError> {
    install_with(catalogue, folder, &InstallOptions::default())
}

/// Returns the networks in a folder; records are no networks.
fn networks_in(folder: &Path) -> Vec<String> {
    let mut found: Vec<String> = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|file| file.path().is_file())
        .map(|file| file.file_name().to_string_lossy().into_owned())
        .filter(|name| !name.ends_with(".toml"))
        .collect();
    found.sort();
    found
}

fn assert_one_line(error: &NnError, reported: &[&str]) {
    let text = error.to_string();
    assert!(!text.contains('\n'), "{text}");
    for part in reported {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn both_members_of_an_archive_take_one_download() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let (encoder, decoder) = (public("encoder-hwc.onnx"), public("decoder-single.onnx"));
    let archive = zip(&[("a/enc.onnx", &encoder), ("dec.onnx", &decoder)]);
    let server = Server::start(&[("sam.zip", archive.clone())], Some(2_000));
    let file = |name: &str, member: &str, content: &[u8]| {
        format!(
            "[[entry.file]]\nname = '{name}'\nsha256 = '{}'\nfrom = [{{ url = '{}', member = '{member}', bytes = {}, sha256 \
             = '{}' }}]\n",
            digest(content),
            server.url("sam.zip"),
            archive.len(),
            digest(&archive)
        )
    };
    let text =
        file("net-e.onnx", "a/enc.onnx", &encoder) + &file("net-d.onnx", "dec.onnx", &decoder);
    let catalogue = entry_of(&text);
    let error = install_net(&catalogue, scratch.path()).unwrap_err();
    assert_one_line(&error, &["cannot be fetched", "kept for another try"]);
    assert!(networks_in(scratch.path()).is_empty());
    let added = install_net(&catalogue, scratch.path()).unwrap();
    assert_eq!(fs::read(&added[0].path).unwrap(), encoder);
    assert_eq!(fs::read(&added[1].path).unwrap(), decoder);
    assert_eq!(
        server.requests(),
        [("/sam.zip".to_owned(), 0), ("/sam.zip".to_owned(), 2_000)],
        "the second run continues, and the second member needs no download"
    );
    assert!(!scratch.path().join("downloads/net").exists());
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn compressed_network_with_weights_in_their_own_file_is_installed() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let (network, weights) = (public("encoder-data.onnx"), public("encoder-data.bin"));
    let packed = gzip(&network);
    let server = Server::start(
        &[("n.onnx.gz", packed.clone()), ("weights", weights.clone())],
        None,
    );
    let text = format!(
        "[[entry.file]]\nname = 'net.onnx'\nsha256 = '{}'\nfrom = [{{ url = '{}', gzip = true, sha256 = '{}' }}]\n\
         [[entry.file]]\nname = 'encoder-data.bin'\ndata = true\nurl = '{}'\nsha256 = '{}'\nbytes = {}\n",
        digest(&network),
        server.url("n.onnx.gz"),
        digest(&packed),
        server.url("weights"),
        digest(&weights),
        weights.len()
    );
    let catalogue = entry_of(&text);
    install_net(&catalogue, scratch.path()).unwrap();
    assert_eq!(
        networks_in(scratch.path()),
        ["encoder-data.bin", "net.onnx"]
    );
    let checked = check(&catalogue, scratch.path(), "net").unwrap();
    assert!(checked[0].signature.is_some() && checked[1].signature.is_none());
    fs::remove_file(scratch.path().join("encoder-data.bin")).unwrap();
    let error = check(&catalogue, scratch.path(), "net").unwrap_err();
    assert_one_line(&error, &["`net` is not installed"]);
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn next_address_is_tried_if_one_does_not_answer() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let network = public("encoder-x.onnx");
    let server = Server::start(&[("there.onnx", network.clone())], None);
    let text = |second: &str| {
        format!(
            "[[entry.file]]\nname = 'net.onnx'\nsha256 = '{}'\nfrom = [{{ url = '{}' }}, {{ url = '{}' }}]\n",
            digest(&network),
            server.url("missing.onnx"),
            server.url(second)
        )
    };
    let error = install_net(&entry_of(&text("gone.onnx")), scratch.path()).unwrap_err();
    assert_one_line(&error, &["gone.onnx", "404"]);
    install_net(&entry_of(&text("there.onnx")), scratch.path()).unwrap();
    assert_eq!(networks_in(scratch.path()), ["net.onnx"]);
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn digest_of_the_first_download_is_recorded_and_reported() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let network = public("encoder-x.onnx");
    let server = Server::start(
        &[
            ("a.onnx", network.clone()),
            ("b.onnx", public("encoder-hwc.onnx")),
        ],
        None,
    );
    let catalogue = |name: &str| {
        entry_of(&format!(
            "[[entry.file]]\nname = 'net.onnx'\nurl = '{}'\n",
            server.url(name)
        ))
    };
    let added = install_net(&catalogue("a.onnx"), scratch.path()).unwrap();
    assert_eq!(added[0].sha256, digest(&network));
    assert!(!added[0].is_known);
    // The same address has another file now.
    let changed = Server::start(&[("a.onnx", public("encoder-hwc.onnx"))], None);
    let records = scratch.path().join("records.toml");
    let text = fs::read_to_string(&records).unwrap();
    let text = text.replace(&server.address, &changed.address);
    fs::write(&records, text).unwrap();
    let url = changed.url("a.onnx");
    let moved = entry_of(&format!(
        "[[entry.file]]\nname = 'net.onnx'\nurl = '{url}'\n"
    ));
    let error = install_net(&moved, scratch.path()).unwrap_err();
    assert_one_line(&error, &[&digest(&network), "nothing was installed"]);
    assert_eq!(
        fs::read(scratch.path().join("net.onnx")).unwrap(),
        network,
        "the installed file stays"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn licence_has_to_be_accepted_once() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let network = public("encoder-x.onnx");
    let server = Server::start(&[("a.onnx", network.clone())], None);
    let text = format!(
        "accept_licence = 'https://licence.example'\n[[entry.file]]\nname = 'net.onnx'\nurl = '{}'\nsha256 = '{}'\n",
        server.url("a.onnx"),
        digest(&network)
    );
    let catalogue = entry_of(&text);
    let to_accept = || list(&catalogue, scratch.path()).remove(0).licence_to_accept;
    let error = install_net(&catalogue, scratch.path()).unwrap_err();
    assert_one_line(
        &error,
        &["MIT", "https://licence.example", "--accept-licence"],
    );
    assert!(server.requests().is_empty(), "nothing is downloaded before");
    assert!(to_accept().is_some());
    let accepting = InstallOptions {
        accept_licence: true,
        ..InstallOptions::default()
    };
    install_with(&catalogue, scratch.path(), &accepting).unwrap();
    assert_eq!(to_accept(), None);
    remove(&catalogue, scratch.path(), "net").unwrap();
    install_net(&catalogue, scratch.path()).unwrap();
    let changed = text.replace("accept_licence", "licence = 'GPL'\naccept_licence");
    let changed = Catalogue::parse(&format!(
        "[[entry]]\nname = 'net'\npurpose = 'p'\nsource = 'https://s'\n{changed}"
    ));
    let error = install_net(&changed.unwrap(), scratch.path()).unwrap_err();
    assert_one_line(&error, &["GPL"]);
}

/// Returns an entry with two variants of different interfaces.
fn two_variants(server: &Server) -> Catalogue {
    let variant = |name: &str, dialect: &str, file: &str, input: &str| {
        let content = public(file);
        format!(
            "[[entry.variant]]\nname = '{name}'\nsummary = 's'\ndialect = '{dialect}'\nmemory_mb = 5\n[[entry.variant.file]]\n\
             name = 'net.onnx'\nurl = '{}'\nbytes = {}\nsha256 = '{}'\ninputs = [{input}]\noutputs = []\n",
            server.url(file),
            content.len(),
            digest(&content)
        )
    };
    let hwc = "{ name = 'input_image', element = 'f32', shape = [-1, -1, 3] }";
    let x = "{ name = 'x', element = 'f32', shape = [1, 3, 1024, 1024] }";
    entry_of(
        &(variant("full", "sam-hwc", "encoder-hwc.onnx", hwc)
            + &variant("int8", "sam-x", "encoder-x.onnx", x)),
    )
}

fn variant_of(entry: &CatalogueEntry, catalogue: &Catalogue, folder: &Path) -> Option<String> {
    let rows = list(catalogue, folder);
    let row = rows.iter().find(|row| row.name == entry.name).unwrap();
    row.installed_variant.clone()
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn variant_can_be_chosen_and_replaced() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let files = ["encoder-hwc.onnx", "encoder-x.onnx"].map(|name| (name, public(name)));
    let server = Server::start(&files, None);
    let catalogue = two_variants(&server);
    let entry = catalogue.entry("net").unwrap();
    install_net(&catalogue, scratch.path()).unwrap();
    assert_eq!(
        variant_of(entry, &catalogue, scratch.path()).as_deref(),
        Some("full")
    );
    record_test(
        &catalogue,
        scratch.path(),
        "net",
        &TestResult::Failed("wrong".into()),
    )
    .unwrap();
    assert!(entry.tested(scratch.path()).is_some() && !entry.is_usable(scratch.path()));
    let chosen = |name: &str| InstallOptions {
        variant: Some(name.to_owned()),
        ..InstallOptions::default()
    };
    install_with(&catalogue, scratch.path(), &chosen("int8")).unwrap();
    assert_eq!(
        variant_of(entry, &catalogue, scratch.path()).as_deref(),
        Some("int8")
    );
    assert_eq!(
        entry.tested(scratch.path()),
        None,
        "the result was of other files"
    );
    assert!(entry.is_usable(scratch.path()));
    let error = install_with(&catalogue, scratch.path(), &chosen("half")).unwrap_err();
    assert_one_line(&error, &["no variant `half`", "full, int8"]);
    let listed = addresses(&catalogue, Some("net")).unwrap();
    assert_eq!(listed.len(), 2);
    assert_eq!(listed[1].variant, "int8");
    assert_eq!(listed[1].urls, [server.url("encoder-x.onnx")]);
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn added_variant_of_the_same_interface_is_known_by_its_digest() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let variant = |name: &str, file: &str| {
        format!(
            "[[entry.variant]]\nname = '{name}'\nsummary = 's'\n[[entry.variant.file]]\nname = 'net.onnx'\nsha256 = '{}'\n",
            digest(&public(file))
        )
    };
    let catalogue = entry_of(
        &(variant("half", "decoder-multi.onnx") + &variant("int8", "decoder-single.onnx")),
    );
    let entry = catalogue.entry("net").unwrap();
    for (file, expected) in [
        ("decoder-single.onnx", "int8"),
        ("decoder-multi.onnx", "half"),
    ] {
        let given = scratch.path().join(file);
        fs::write(&given, public(file)).unwrap();
        let folder = scratch.path().join(expected);
        let added = add(&catalogue, &folder, "net", &[given]).unwrap();
        assert!(added[0].is_known, "{file}");
        let variant = variant_of(entry, &catalogue, &folder);
        assert_eq!(variant.as_deref(), Some(expected));
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn network_with_another_interface_is_not_installed() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let files = [
        ("encoder-hwc.onnx", public("decoder-multi.onnx")),
        ("encoder-x.onnx", public("encoder-x.onnx")),
    ];
    let server = Server::start(&files, None);
    let text = format!(
        "[[entry.file]]\nname = 'net.onnx'\nurl = '{}'\ninputs = [{{ name = 'x', element = 'f32', shape = [1, 3, 1024, 1024] \
         }}]\noutputs = []\n",
        server.url("encoder-hwc.onnx")
    );
    let error = install_net(&entry_of(&text), scratch.path()).unwrap_err();
    assert_one_line(&error, &["`x` f32 [1, 3, 1024, 1024]", "another network"]);
    assert!(networks_in(scratch.path()).is_empty());
    assert!(!scratch.path().join("downloads/net").exists());
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn damaged_archive_is_reported_and_deleted() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let network = public("encoder-x.onnx");
    let mut packed = gzip(&network);
    let middle = packed.len() / 2;
    packed[middle] ^= 0x40;
    let server = Server::start(&[("n.gz", packed)], None);
    let text = format!(
        "[[entry.file]]\nname = 'net.onnx'\nsha256 = '{}'\nfrom = [{{ url = '{}', gzip = true }}]\n",
        digest(&network),
        server.url("n.gz")
    );
    let error = install_net(&entry_of(&text), scratch.path()).unwrap_err();
    assert_one_line(&error, &["n.gz", "nothing was installed"]);
    assert!(networks_in(scratch.path()).is_empty());
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn downloaded_files_can_be_taken_from_a_folder() {
    Runtime::find().unwrap();
    let (scratch, given) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let network = public("encoder-x.onnx");
    let text = format!(
        "[[entry.file]]\nname = 'net.onnx'\nurl = 'https://host.example/folder/public-name.onnx'\nsha256 = '{}'\n",
        digest(&network)
    );
    let catalogue = entry_of(&text);
    let options = InstallOptions {
        from: Some(given.path().to_owned()),
        ..InstallOptions::default()
    };
    let error = install_with(&catalogue, scratch.path(), &options).unwrap_err();
    assert_one_line(&error, &["public-name.onnx", "ostra models addresses net"]);
    let on_server = given.path().join("host.example/folder");
    fs::create_dir_all(&on_server).unwrap();
    let places: [PathBuf; 3] = [
        on_server.join("public-name.onnx"),
        given.path().join("public-name.onnx"),
        given.path().join("net.onnx"),
    ];
    for place in &places {
        fs::write(place, &network).unwrap();
        install_with(&catalogue, scratch.path(), &options).unwrap();
        assert_eq!(fs::read(place).unwrap(), network, "the given file is kept");
        remove(&catalogue, scratch.path(), "net").unwrap();
        fs::remove_file(place).unwrap();
    }
    fs::write(&places[1], b"something else").unwrap();
    let error = install_with(&catalogue, scratch.path(), &options).unwrap_err();
    assert_one_line(&error, &["public-name.onnx", &digest(&network)]);
    assert!(places[1].exists() && networks_in(scratch.path()).is_empty());
}

#[test]
fn download_that_does_not_fit_on_the_disk_is_not_started() {
    let scratch = tempfile::tempdir().unwrap();
    let server = Server::start(&[], None);
    let text = format!(
        "[[entry.file]]\nname = 'net.onnx'\nurl = '{}'\nbytes = 1000000000000000000\n",
        server.url("a")
    );
    let error = install_net(&entry_of(&text), scratch.path()).unwrap_err();
    assert_one_line(&error, &["needs 1000000000000 MB", "MB free"]);
    assert!(server.requests().is_empty() && !scratch.path().join("downloads").exists());
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn removed_network_leaves_nothing_behind() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let network = public("encoder-x.onnx");
    let server = Server::start(&[("a.onnx", network)], None);
    let text = format!(
        "[[entry.file]]\nname = 'net.onnx'\nurl = '{}'\n",
        server.url("a.onnx")
    );
    let catalogue = entry_of(&text);
    let error = remove(&catalogue, scratch.path(), "net").unwrap_err();
    assert_one_line(&error, &["`net` is not installed"]);
    install_net(&catalogue, scratch.path()).unwrap();
    let removed = remove(&catalogue, scratch.path(), "net").unwrap();
    assert_eq!(removed, [scratch.path().join("net.onnx")]);
    for record in ["records.toml", "digests.toml"] {
        let text = fs::read_to_string(scratch.path().join(record)).unwrap();
        assert_eq!(text.trim(), "", "{record}");
    }
    assert!(networks_in(scratch.path()).is_empty());
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn dialect_is_recognised_by_the_interface() {
    Runtime::find().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let encoders = [
        ("encoder-hwc.onnx", Dialect::SamHwc),
        ("encoder-x.onnx", Dialect::SamX),
        ("encoder-image.onnx", Dialect::Sam),
    ];
    for (encoder, dialect) in encoders {
        // Files that were copied by hand have no record.
        fs::write(
            scratch.path().join("sam-vit-b-encoder.onnx"),
            public(encoder),
        )
        .unwrap();
        fs::write(
            scratch.path().join("sam-vit-b-decoder.onnx"),
            public("decoder-single.onnx"),
        )
        .unwrap();
        let loaded = load_with_dialect(scratch.path(), "sam-vit-b").unwrap();
        assert_eq!(loaded.dialect, Some(dialect), "{encoder}");
    }
}
