//! Checks that no two files of a crate import each other, directly or through others.
//!
//! Cargo checks this between crates, but not inside one.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Path of a module below its crate.
type Module = Vec<String>;

/// Product code of a crate by module.
struct Sources {
    code: BTreeMap<Module, String>,
    /// Modules that hold only documentation, declarations and re-exports.
    roots: BTreeSet<Module>,
    /// Path behind each re-exported name, by module.
    exports: BTreeMap<Module, BTreeMap<String, Vec<String>>>,
}

impl Sources {
    fn read(folder: &Path) -> Self {
        let mut sources = Self {
            code: BTreeMap::new(),
            roots: BTreeSet::new(),
            exports: BTreeMap::new(),
        };
        for path in rust_files(folder) {
            let below = path.strip_prefix(folder).unwrap().with_extension("");
            let mut module: Module = below
                .iter()
                .map(|part| part.to_string_lossy().into_owned())
                .collect();
            if module
                .iter()
                .any(|part| part.ends_with("tests") || part == "testing")
            {
                continue;
            }
            if module
                .last()
                .is_some_and(|last| ["mod", "lib", "main"].contains(&last.as_str()))
            {
                module.pop();
                sources.roots.insert(module.clone());
            }
            let text = std::fs::read_to_string(&path).unwrap();
            sources.code.insert(module, product_code(&text));
        }
        for (module, code) in &sources.code {
            let exports = uses(code).into_iter().filter(|one| one.is_public);
            let named = exports
                .filter_map(|one| Some((one.name?, one.path)))
                .collect();
            sources.exports.insert(module.clone(), named);
        }
        sources
    }

    /// Returns the module that `path` in `module` leads to; `None` outside the crate.
    fn resolve(&self, module: &[String], path: &[String], depth: usize) -> Option<Module> {
        let mut at: Module = module.to_vec();
        let mut rest = path;
        match rest.first()?.as_str() {
            "crate" => (at, rest) = (Vec::new(), &rest[1..]),
            "self" => rest = &rest[1..],
            "super" => {
                while rest.first().is_some_and(|word| word == "super") {
                    at.pop();
                    rest = &rest[1..];
                }
            }
            first => {
                let child = [module, &[first.to_owned()]].concat();
                let is_export = self
                    .exports
                    .get(module)
                    .is_some_and(|all| all.contains_key(first));
                if !self.code.contains_key(&child) && !is_export {
                    return None;
                }
            }
        }
        while let Some((name, after)) = rest.split_first() {
            let child = [at.as_slice(), std::slice::from_ref(name)].concat();
            if self.code.contains_key(&child) {
                (at, rest) = (child, after);
                continue;
            }
            let behind = self.exports.get(&at).and_then(|all| all.get(name));
            if let Some(behind) = behind.filter(|_| depth < 8) {
                let path = [behind, after].concat();
                if let Some(found) = self.resolve(&at, &path, depth + 1) {
                    return Some(found);
                }
            }
            break;
        }
        Some(at)
    }

    /// Returns the files of the crate that each file imports, directly or through module roots.
    fn imports(&self) -> BTreeMap<&Module, BTreeSet<&Module>> {
        let files = self
            .code
            .iter()
            .filter(|(module, _)| !self.roots.contains(*module));
        let of = |module: &Module, code: &str| {
            let paths = uses(code)
                .into_iter()
                .map(|one| one.path)
                .chain(inline_paths(code));
            let found = paths.filter_map(|path| self.resolve(module, &path, 0));
            let found: BTreeSet<Module> = found.filter(|found| found != module).collect();
            found
        };
        files
            .map(|(module, code)| {
                let found = of(module, code);
                let known = self.code.keys().filter(|other| found.contains(*other));
                (module, known.collect())
            })
            .collect()
    }
}

/// One name that a `use` imports.
struct Use {
    path: Vec<String>,
    /// `None` for `*` and `_`.
    name: Option<String>,
    is_public: bool,
}

fn uses(code: &str) -> Vec<Use> {
    let mut found = Vec::new();
    for statement in code.split(';') {
        let Some(at) = statement.rfind("use ") else {
            continue;
        };
        let (before, tree) = (&statement[..at], &statement[at + 4..]);
        let line = before.rsplit('\n').next().unwrap_or_default().trim();
        if !(line.is_empty() || line == "pub" || (line.starts_with("pub(") && line.ends_with(')')))
        {
            continue;
        }
        for leaf in leaves(tree) {
            let (path, alias) = match leaf.split_once(" as ") {
                Some((path, alias)) => (path.to_owned(), Some(alias.trim().to_owned())),
                None => (leaf, None),
            };
            let mut path: Vec<String> = path
                .split("::")
                .map(|word| word.trim().to_owned())
                .collect();
            let is_glob = path.last().is_some_and(|last| last == "*");
            if path
                .last()
                .is_some_and(|last| last == "*" || last == "self")
                && path.len() > 1
            {
                path.pop();
            }
            let name = alias
                .or_else(|| path.last().cloned())
                .filter(|name| !is_glob && name != "_");
            let is_public = line.starts_with("pub");
            found.push(Use {
                path,
                name,
                is_public,
            });
        }
    }
    found
}

/// Returns the paths of a tree of imports: `a::{b, c::d}` gives `a::b` and `a::c::d`.
fn leaves(tree: &str) -> Vec<String> {
    let tree = tree.trim();
    let Some(open) = tree.find('{') else {
        return vec![tree.to_owned()];
    };
    let (head, inner) = (
        &tree[..open],
        &tree[open + 1..tree.rfind('}').unwrap_or(tree.len())],
    );
    let (mut depth, mut start, mut parts) = (0, 0, Vec::new());
    for (at, letter) in inner.char_indices() {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&inner[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&inner[start..]);
    let parts = parts.into_iter().filter(|part| !part.trim().is_empty());
    parts
        .flat_map(leaves)
        .map(|leaf| format!("{head}{leaf}"))
        .collect()
}

/// Returns the paths in code, outside of `use`, that start with `crate` or `super`.
fn inline_paths(code: &str) -> Vec<Vec<String>> {
    let is_word = |letter: char| letter.is_alphanumeric() || letter == '_' || letter == ':';
    let words = code.split(|letter: char| !is_word(letter));
    let paths = words.filter(|word| word.starts_with("crate::") || word.starts_with("super::"));
    let parts = |path: &str| {
        path.split("::")
            .filter(|part| !part.is_empty())
            .map(str::to_owned)
            .collect()
    };
    paths.map(parts).collect()
}

pub(super) fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Returns the code without comments and without its test module.
pub(super) fn product_code(text: &str) -> String {
    let code = text
        .split("#[cfg(test)]\nmod tests {")
        .next()
        .unwrap_or_default();
    let without_comment =
        |line: &str| line.split("//").next().unwrap_or_default().to_owned() + "\n";
    code.lines().map(without_comment).collect()
}

/// Returns the groups of files that import each other, directly or through others.
fn circles<'m>(imports: &BTreeMap<&'m Module, BTreeSet<&'m Module>>) -> Vec<BTreeSet<&'m Module>> {
    let reach = |from: &'m Module| {
        let (mut reached, mut next) = (BTreeSet::new(), vec![from]);
        while let Some(module) = next.pop() {
            for &import in imports.get(module).into_iter().flatten() {
                if reached.insert(import) {
                    next.push(import);
                }
            }
        }
        reached
    };
    let reached: BTreeMap<&Module, BTreeSet<&Module>> = imports
        .keys()
        .map(|&module| (module, reach(module)))
        .collect();
    let mut found: Vec<BTreeSet<&Module>> = Vec::new();
    for (&module, others) in &reached {
        if others.contains(module) && !found.iter().any(|circle| circle.contains(module)) {
            let is_back = |other: &&&Module| {
                reached
                    .get(*other)
                    .is_some_and(|back| back.contains(module))
            };
            found.push(others.iter().filter(is_back).copied().collect());
        }
    }
    found
}

fn circles_below(folder: &Path) -> Vec<String> {
    let sources = Sources::read(folder);
    let named = |circle: BTreeSet<&Module>| {
        let names: Vec<String> = circle.into_iter().map(|module| module.join("::")).collect();
        names.join(", ")
    };
    circles(&sources.imports()).into_iter().map(named).collect()
}

#[test]
fn no_files_of_a_crate_import_each_other() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut wrong = Vec::new();
    for entry in std::fs::read_dir(&src).unwrap() {
        let folder = entry.unwrap().path();
        if folder.is_dir() {
            let name = folder.file_name().unwrap().to_string_lossy().into_owned();
            let circles = circles_below(&folder);
            if !circles.is_empty() {
                wrong.push(format!("{name}: {circles:#?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn cycle_through_a_module_root_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    std::fs::create_dir(folder.path().join("part")).unwrap();
    write(
        "lib.rs",
        "mod part;\nmod user;\npub use part::{Thing, Other as Renamed};\n",
    );
    write(
        "part/mod.rs",
        "mod other;\nmod thing;\npub use other::Other;\npub use thing::Thing;\n",
    );
    write(
        "part/thing.rs",
        "use super::Other;\npub struct Thing(Other);\n",
    );
    write("part/other.rs", "pub struct Other;\n// use crate::Thing;\n");
    write(
        "user.rs",
        "use crate::{\n    Renamed, Thing,\n};\npub fn user(_: Thing, _: Renamed) {}\n",
    );
    assert!(circles_below(folder.path()).is_empty());
    write(
        "part/other.rs",
        "pub struct Other;\nfn of() -> crate::part::Thing { todo!() }\n",
    );
    assert_eq!(circles_below(folder.path()), ["part::other, part::thing"]);
    write(
        "part/other.rs",
        "#[cfg(test)]\nmod tests {\n    use crate::Thing;\n}\n",
    );
    assert!(
        circles_below(folder.path()).is_empty(),
        "tests may look at all"
    );
}
