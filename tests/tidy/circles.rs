//! Files that import each other in a circle. A module file and the files of its own folder count as one thing: their
//! imports of each other are not counted.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A module's path from the crate's root: `["world", "scene"]`.
type Module = Vec<String>;

/// One line per circle: its files, sorted.
pub fn circles(root: &Path) -> Vec<String> {
    let modules = modules(root);
    let texts: BTreeMap<&Module, String> = modules
        .iter()
        .map(|(module, file)| (module, code(&std::fs::read_to_string(file).unwrap())))
        .collect();
    let imports: BTreeMap<&Module, Imports> =
        texts.iter().map(|(module, text)| (*module, Imports::read(module, text, &modules))).collect();
    let arrows: BTreeMap<&Module, BTreeSet<&Module>> = imports
        .iter()
        .map(|(module, own)| {
            let target = |path: &Module| target(path, &imports, 0);
            let targets = own.used.iter().filter_map(target).filter(|other| !are_one(module, other));
            (*module, targets.collect())
        })
        .collect();
    let reached: BTreeMap<&Module, BTreeSet<&Module>> =
        arrows.keys().map(|module| (*module, reached(module, &arrows))).collect();
    let together = |a: &Module, b: &Module| reached[a].contains(b) && reached[b].contains(a);
    let in_circle = reached.keys().filter(|module| reached[**module].contains(**module));
    let circles: BTreeSet<String> = in_circle
        .map(|module| {
            let members = reached.keys().filter(|other| together(module, other));
            members.map(|member| modules[*member].display().to_string()).collect::<Vec<_>>().join(", ")
        })
        .collect();
    circles.into_iter().collect()
}

fn reached<'a>(from: &Module, arrows: &BTreeMap<&'a Module, BTreeSet<&'a Module>>) -> BTreeSet<&'a Module> {
    let mut reached = BTreeSet::new();
    let mut waiting: Vec<&Module> = arrows[from].iter().copied().collect();
    while let Some(module) = waiting.pop() {
        if reached.insert(module) {
            waiting.extend(&arrows[module]);
        }
    }
    reached
}

fn are_one(a: &Module, b: &Module) -> bool {
    a.starts_with(b) || b.starts_with(a)
}

/// Every module of a source folder that is no test, with its file.
fn modules(root: &Path) -> BTreeMap<Module, PathBuf> {
    let mut modules = BTreeMap::new();
    for file in super::rust_files(root) {
        let relative = file.strip_prefix(root).unwrap().with_extension("");
        let mut module: Module = relative.iter().map(|part| part.to_str().unwrap().to_owned()).collect();
        if module.iter().any(|part| part == "tests" || part.ends_with("_tests")) || module == ["main"] {
            continue;
        }
        if module.last().is_some_and(|last| last == "mod" || last == "lib") {
            module.pop();
        }
        modules.insert(module, file);
    }
    modules
}

/// A file's text without its tests and comments.
fn code(text: &str) -> String {
    let text = text.split("#[cfg(test)]").next().unwrap_or_default();
    let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    lines.collect::<Vec<_>>().join("\n")
}

#[derive(Default)]
struct Imports {
    used: Vec<Module>,
    /// Names that a module hands on, with the path that they come from.
    handed_on: BTreeMap<String, Module>,
}

impl Imports {
    fn read(module: &Module, text: &str, modules: &BTreeMap<Module, PathBuf>) -> Self {
        let mut imports = Self::default();
        for statement in text.split(';') {
            let Some((start, is_public, tree)) = import(statement) else {
                imports.read_paths(module, statement, modules);
                continue;
            };
            imports.read_paths(module, &statement[..start], modules);
            for path in leaves(tree) {
                let Some(absolute) = absolute(&path, module, modules) else { continue };
                match absolute.last().filter(|_| is_public).cloned() {
                    Some(name) => drop(imports.handed_on.insert(name, absolute)),
                    None => imports.used.push(absolute),
                }
            }
        }
        imports
    }

    /// Paths in the code itself.
    fn read_paths(&mut self, module: &Module, text: &str, modules: &BTreeMap<Module, PathBuf>) {
        let words = text.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':'));
        for word in words.filter(|word| word.contains("::")) {
            let path: Module = word.split("::").filter(|part| !part.is_empty()).map(str::to_owned).collect();
            self.used.extend(absolute(&path, module, modules));
        }
    }
}

/// Where the import of a statement begins, whether it hands names on, and its tree.
fn import(statement: &str) -> Option<(usize, bool, &str)> {
    let lines = statement.match_indices('\n').map(|(at, _)| at + 1);
    std::iter::once(0).chain(lines).find_map(|start| {
        let line = statement[start..].trim_start();
        let rest =
            line.strip_prefix("pub").map_or(line, |rest| rest.split_once(' ').map_or("", |(_, rest)| rest));
        Some((start, line.starts_with("pub"), rest.strip_prefix("use ")?))
    })
}

fn parts(path: &str) -> Module {
    path.split("::").map(|part| part.trim().to_owned()).filter(|part| !part.is_empty()).collect()
}

/// The paths of a tree of imports: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn leaves(tree: &str) -> Vec<Module> {
    let tree = tree.trim();
    let Some(open) = tree.find('{') else {
        let path = tree.split(" as ").next().unwrap_or_default();
        return vec![parts(path)];
    };
    let close = tree.rfind('}').unwrap_or(tree.len());
    let head = parts(&tree[..open]);
    let mut depth = 0;
    let split = |c: char| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        c == ',' && depth == 0
    };
    let branches = tree[open + 1..close].split(split).filter(|branch| !branch.trim().is_empty());
    branches.flat_map(leaves).map(|leaf| [head.clone(), leaf].concat()).collect()
}

/// A path from the crate's root; none of other crates, nor of what has no module of its own.
fn absolute(path: &[String], module: &Module, modules: &BTreeMap<Module, PathBuf>) -> Option<Module> {
    let mut base = module.clone();
    let mut rest = path;
    match rest.first()?.as_str() {
        "crate" => return Some(rest[1..].to_vec()),
        "self" => rest = &rest[1..],
        "super" => {}
        first => {
            base.push(first.to_owned());
            return modules.contains_key(&base).then(|| [module.as_slice(), path].concat());
        }
    }
    while rest.first().is_some_and(|part| part == "super") {
        base.pop()?;
        rest = &rest[1..];
    }
    Some([base.as_slice(), rest].concat())
}

/// The module whose file defines what a path names.
fn target<'a>(path: &Module, imports: &BTreeMap<&'a Module, Imports>, depth: usize) -> Option<&'a Module> {
    let (module, own) =
        (0..=path.len()).rev().find_map(|length| imports.get_key_value(&path[..length].to_vec()))?;
    let rest = &path[module.len()..];
    let origin = rest.first().and_then(|name| own.handed_on.get(name));
    match origin {
        Some(origin) if depth < 6 && origin != path => {
            target(&[origin.as_slice(), &rest[1..]].concat(), imports, depth + 1)
        }
        _ => Some(module),
    }
}
