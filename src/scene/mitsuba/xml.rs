//! From XML to the tree of a scene: includes, parameters and references are resolved.

use super::super::input::read_file;
use super::super::load::LoadError;
use super::document::{Document, Node, Place, Property, Tag, Value};
use super::parameters::Parameters;
use super::spectrum::SpectrumValue;
use super::transform;
use super::xml_value::{boolean, integer, number, triple};
use crate::math::DMat4;
use roxmltree::{Document as Xml, Node as Element, ParsingOptions};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Files within files, at most.
const MAX_INCLUDE_DEPTH: u32 = 15;
/// Included files, counted each time, at most: files that include each other twice would double with each.
const MAX_INCLUDES: u32 = 1000;
/// Bytes of all files, counted each time they are included.
const MAX_TEXT: usize = 1 << 30;
/// Elements within elements, at most.
const MAX_ELEMENT_DEPTH: u32 = 64;

/// Reads a scene and what it includes. `defines` are parameters and their values.
pub(super) fn read(path: &Path, defines: &[(String, String)]) -> Result<Document, LoadError> {
    let mut reader = Reader {
        document: Document {
            nodes: Vec::new(),
            files: Vec::new(),
            search: vec![path.parent().unwrap_or(Path::new("")).to_owned()],
            hasher: blake3::Hasher::new(),
        },
        parameters: Parameters::default(),
        ids: HashMap::new(),
        includes: 0,
        text: 0,
    };
    for (name, value) in defines {
        reader.parameters.add(name, value, false);
        reader.document.hasher.update(format!("{name}={value}\n").as_bytes());
    }
    reader.read_file(path, None, 0)?;
    if let Some(unused) = reader.parameters.unused() {
        return Err(LoadError::Key {
            path: path.to_owned(),
            key: format!("-D {}={}", unused.name, unused.value),
            problem: format!(
                "the scene does not use ${}; remove the option or correct the name",
                unused.name
            ),
        });
    }
    reader.resolve()?;
    reader.document.refuse_cycles()?;
    Ok(reader.document)
}

struct Reader {
    document: Document,
    parameters: Parameters,
    ids: HashMap<String, usize>,
    includes: u32,
    text: usize,
}

/// The file that is being read.
#[derive(Clone, Copy)]
struct Source<'a> {
    file: u32,
    include_depth: u32,
    /// Whether names are written in the way of Mitsuba before 2.0.
    is_old: bool,
    /// Offsets of the beginnings of lines.
    lines: &'a [usize],
}

impl Source<'_> {
    fn place(&self, element: Element) -> Place {
        let offset = element.range().start;
        Place {
            file: self.file,
            line: self.lines.partition_point(|&start| start <= offset) as u32,
        }
    }
}

/// The attributes of an element, parameters replaced.
struct Attributes(Vec<(&'static str, String)>);

impl Attributes {
    fn get(&self, name: &str) -> Option<&str> {
        self.0
            .iter()
            .find(|(known, _)| *known == name)
            .map(|(_, value)| value.as_str())
    }

    /// One that is known to be there.
    fn of(&self, name: &str) -> &str {
        self.get(name).unwrap_or_default()
    }
}

impl Reader {
    /// Reads a file into the object `parent`, which is absent for the scene itself. `name`: see [`Property::name`].
    fn read_file(&mut self, path: &Path, parent: Option<(usize, &str)>, depth: u32) -> Result<(), LoadError> {
        let bytes = read_file(path)?;
        let syntax = |message: String| LoadError::Syntax {
            path: path.to_owned(),
            message,
        };
        self.text += bytes.len();
        if self.text > MAX_TEXT {
            return Err(syntax(format!(
                "the scene and what it includes have more than {MAX_TEXT} bytes"
            )));
        }
        self.document.hasher.update(blake3::hash(&bytes).as_bytes());
        let text = std::str::from_utf8(&bytes).map_err(|e| syntax(format!("not UTF-8 text: {e}")))?;
        let xml = Xml::parse_with_options(text, ParsingOptions::default()).map_err(|e| {
            syntax(match e {
                roxmltree::Error::DtdDetected => {
                    "a document type declaration is refused: its entities could expand without end; remove <!DOCTYPE>"
                        .into()
                }
                e => format!("not well-formed XML: {e}"),
            })
        })?;
        let lines: Vec<usize> = std::iter::once(0)
            .chain(
                text.bytes()
                    .enumerate()
                    .filter(|(_, b)| *b == b'\n')
                    .map(|(i, _)| i + 1),
            )
            .collect();
        let file = self.document.files.len() as u32;
        self.document.files.push(path.to_owned());
        let root = xml.root_element();
        let mut source = Source {
            file,
            include_depth: depth,
            is_old: false,
            lines: &lines,
        };
        let place = source.place(root);
        let version = root.attribute("version").ok_or_else(|| {
            let what = format!("<{}>", root.tag_name().name());
            self.document.error(
                place,
                &what,
                "has no attribute `version`; expected <scene version=\"3.0.0\">",
            )
        })?;
        source.is_old = match version
            .split('.')
            .next()
            .and_then(|major| major.trim().parse::<u32>().ok())
        {
            Some(major) => major < 2,
            None => {
                let problem = format!("version \"{version}\" is not of the form 3.0.0");
                return Err(self.document.error(place, "<scene>", problem));
            }
        };
        let is_scene = root.tag_name().name() == "scene";
        match parent {
            None if !is_scene => {
                let what = format!("<{}>", root.tag_name().name());
                Err(self
                    .document
                    .error(place, &what, "is not a scene; expected <scene version=\"3.0.0\">"))
            }
            None => {
                self.document.nodes.push(Node {
                    tag: Tag::Scene,
                    plugin: "scene".into(),
                    id: String::new(),
                    place,
                    properties: Vec::new(),
                });
                self.children(root, source, 0, 0)
            }
            // A scene within a scene is all that is in it.
            Some((parent, _)) if is_scene => self.children(root, source, parent, 0),
            Some((parent, name)) => self.element(root, source, parent, Some(name), 0),
        }
    }

    fn children(&mut self, element: Element, source: Source, parent: usize, depth: u32) -> Result<(), LoadError> {
        for child in element.children().filter(Element::is_element) {
            self.element(child, source, parent, None, depth + 1)?;
        }
        Ok(())
    }

    /// Reads an element within the object `parent`. `name` takes the place of its own.
    fn element(
        &mut self,
        element: Element,
        source: Source,
        parent: usize,
        name: Option<&str>,
        depth: u32,
    ) -> Result<(), LoadError> {
        let place = source.place(element);
        let kind = element.tag_name().name();
        let what = format!("<{kind}>");
        if depth > MAX_ELEMENT_DEPTH {
            let problem = format!("is nested deeper than {MAX_ELEMENT_DEPTH} elements");
            return Err(self.document.error(place, &what, problem));
        }
        if let Some(tag) = Tag::of(kind) {
            return self.object(element, source, tag, parent, name, depth);
        }
        let value = match kind {
            "spectrum" if element.attribute("type").is_some() => {
                return self.object(element, source, Tag::Texture, parent, name, depth);
            }
            "boolean" | "integer" | "float" | "string" | "rgb" | "spectrum" | "vector" | "point" => {
                let allowed: &[&str] = match kind {
                    "vector" | "point" => &["!name", "value", "x", "y", "z"],
                    "spectrum" => &["!name", "value", "filename"],
                    _ => &["!name", "!value"],
                };
                let attributes = self.attributes(element, source, allowed)?;
                self.leaf(element, source)?;
                let value = match kind {
                    "boolean" => boolean(attributes.of("value")).map(Value::Boolean),
                    "integer" => integer(attributes.of("value")).map(Value::Integer),
                    "float" => number(attributes.of("value")).map(Value::Float),
                    "string" => Ok(Value::String(attributes.of("value").to_owned())),
                    "rgb" => triple(attributes.of("value")).map(Value::Rgb),
                    "spectrum" => self.spectrum(&attributes)?.map(Value::Spectrum),
                    _ => transform::vector(|name| attributes.get(name), None).map(Value::Vector),
                };
                let name = attributes.of("name").to_owned();
                let value = value.map_err(|problem| {
                    let what = format!("<{kind} name=\"{name}\">");
                    self.document.error(place, &what, problem)
                })?;
                (name, value)
            }
            "transform" => {
                let name = self.attributes(element, source, &["!name"])?.of("name").to_owned();
                (name, Value::Transform(self.transform(element, source)?))
            }
            "ref" => {
                let attributes = self.attributes(element, source, &["!id", "name"])?;
                self.leaf(element, source)?;
                let name = attributes.of("name").to_owned();
                (name, Value::Reference(attributes.of("id").to_owned()))
            }
            "default" => {
                let attributes = self.attributes(element, source, &["!name", "!value"])?;
                self.leaf(element, source)?;
                // Nobody has to use it, and what was given before counts.
                self.parameters.add(attributes.of("name"), attributes.of("value"), true);
                return Ok(());
            }
            "include" => return self.include(element, source, parent),
            "path" => {
                let attributes = self.attributes(element, source, &["!value"])?;
                self.leaf(element, source)?;
                let beside = self.folder_of(source).join(attributes.of("value"));
                let folder = if beside.exists() {
                    beside
                } else {
                    self.document.file(attributes.of("value"))
                };
                if !folder.exists() {
                    let problem = format!("there is no folder {}", folder.display());
                    return Err(self.document.error(place, &what, problem));
                }
                self.document.search.insert(0, folder);
                return Ok(());
            }
            "alias" => {
                let attributes = self.attributes(element, source, &["!id", "!as"])?;
                self.leaf(element, source)?;
                let Some(&node) = self.ids.get(attributes.of("id")) else {
                    let problem = format!("no object before it has the id \"{}\"", attributes.of("id"));
                    return Err(self.document.error(place, &what, problem));
                };
                return self.add_id(attributes.of("as"), node, place);
            }
            "medium" | "phase" | "volume" => {
                return Err(self.document.error(
                    place,
                    &what,
                    "participating media are not supported; remove it and what refers to it",
                ));
            }
            _ => {
                return Err(self.document.error(
                    place,
                    &what,
                    "is no element of a scene; expected one of scene, integrator, sensor, film, sampler, rfilter, bsdf, \
                     texture, emitter, shape, boolean, integer, float, string, vector, point, rgb, spectrum, transform, \
                     ref, include, default, path, alias",
                ));
            }
        };
        let (name, value) = (self.name(value.0, source), value.1);
        self.add_property(parent, name, place, value)
    }

    fn object(
        &mut self,
        element: Element,
        source: Source,
        tag: Tag,
        parent: usize,
        name: Option<&str>,
        depth: u32,
    ) -> Result<(), LoadError> {
        let place = source.place(element);
        // The root of a file has a version as well.
        let attributes = match (element.parent_element(), tag) {
            (None, _) => self.attributes(element, source, &["version", "!type", "id", "name"])?,
            (_, Tag::Scene) => {
                return Err(self
                    .document
                    .error(place, "<scene>", "stands within an object; it is the root of a file"));
            }
            _ => self.attributes(element, source, &["!type", "id", "name"])?,
        };
        let node = self.document.nodes.len();
        let id = attributes.of("id").to_owned();
        self.document.nodes.push(Node {
            tag,
            plugin: attributes.of("type").to_owned(),
            id: id.clone(),
            place,
            properties: Vec::new(),
        });
        if !id.is_empty() {
            self.add_id(&id, node, place)?;
        }
        let name = self.name(name.unwrap_or(attributes.of("name")).to_owned(), source);
        self.add_property(parent, name, place, Value::Object(node))?;
        self.children(element, source, node, depth)
    }

    fn add_id(&mut self, id: &str, node: usize, place: Place) -> Result<(), LoadError> {
        match self.ids.insert(id.to_owned(), node) {
            None => Ok(()),
            Some(before) => {
                let first = self.document.describe(self.document.nodes[before].place);
                let problem = format!("the object at {first} has the same id; ids are unique");
                Err(self.document.error(place, &format!("id \"{id}\""), problem))
            }
        }
    }

    fn add_property(&mut self, parent: usize, name: String, place: Place, value: Value) -> Result<(), LoadError> {
        let properties = &mut self.document.nodes[parent].properties;
        if !name.is_empty() && properties.iter().any(|property| property.name == name) {
            let what = format!("parameter \"{name}\"");
            return Err(self.document.error(place, &what, "is given twice; remove one of them"));
        }
        properties.push(Property { name, place, value });
        Ok(())
    }

    fn include(&mut self, element: Element, source: Source, parent: usize) -> Result<(), LoadError> {
        let place = source.place(element);
        let attributes = self.attributes(element, source, &["!filename", "name"])?;
        self.leaf(element, source)?;
        self.includes += 1;
        if source.include_depth + 1 > MAX_INCLUDE_DEPTH || self.includes > MAX_INCLUDES {
            let problem = format!(
                "more than {MAX_INCLUDE_DEPTH} files within each other, or {MAX_INCLUDES} in all: does a file include itself?"
            );
            return Err(self.document.error(place, "<include>", problem));
        }
        let beside = self.folder_of(source).join(attributes.of("filename"));
        let path = if beside.exists() {
            beside
        } else {
            self.document.file(attributes.of("filename"))
        };
        // Folders that the file adds count for what it includes itself.
        let search = self.document.search.clone();
        let name = attributes.of("name").to_owned();
        self.read_file(&path, Some((parent, &name)), source.include_depth + 1)?;
        self.document.search = search;
        Ok(())
    }

    fn folder_of(&self, source: Source) -> PathBuf {
        let file = &self.document.files[source.file as usize];
        file.parent().unwrap_or(Path::new("")).to_owned()
    }

    /// Parameters of old scenes were written in camel case.
    fn name(&self, name: String, source: Source) -> String {
        if !source.is_old {
            return name;
        }
        let mut converted = String::with_capacity(name.len() + 4);
        let mut before = ' ';
        for c in name.chars() {
            if c.is_ascii_uppercase() && before.is_ascii_lowercase() {
                converted.push('_');
            }
            converted.push(if before.is_ascii_alphabetic() {
                c.to_ascii_lowercase()
            } else {
                c
            });
            before = c;
        }
        converted
    }

    fn transform(&mut self, element: Element, source: Source) -> Result<DMat4, LoadError> {
        let mut composed = DMat4::IDENTITY;
        for child in element.children().filter(Element::is_element) {
            let kind = child.tag_name().name();
            let Some(allowed) = transform::attributes(kind) else {
                let (place, what) = (source.place(child), format!("<{kind}>"));
                let problem = "is no part of a transform; expected translate, rotate, scale, lookat or matrix";
                return Err(self.document.error(place, &what, problem));
            };
            let attributes = self.attributes(child, source, allowed)?;
            self.leaf(child, source)?;
            let step = transform::step(kind, |name| attributes.get(name))
                .map_err(|problem| self.document.error(source.place(child), &format!("<{kind}>"), problem))?;
            composed = step * composed;
        }
        if composed.is_finite() {
            Ok(composed)
        } else {
            let problem = "its product is not finite; bring the numbers nearer to 1";
            Err(self.document.error(source.place(element), "<transform>", problem))
        }
    }

    fn spectrum(&mut self, attributes: &Attributes) -> Result<Result<SpectrumValue, String>, LoadError> {
        match (attributes.get("value"), attributes.get("filename")) {
            (Some(value), None) => Ok(SpectrumValue::parse(value)),
            (None, Some(filename)) => {
                let bytes = read_file(&self.document.file(filename))?;
                self.document.hasher.update(blake3::hash(&bytes).as_bytes());
                Ok(SpectrumValue::parse_file(&String::from_utf8_lossy(&bytes)))
            }
            _ => Ok(Err("expected either `value` or `filename`".into())),
        }
    }

    /// The attributes of an element, which are among `allowed`; those marked with `!` are required.
    fn attributes(
        &mut self,
        element: Element,
        source: Source,
        allowed: &[&'static str],
    ) -> Result<Attributes, LoadError> {
        let place = source.place(element);
        let what = || format!("<{}>", element.tag_name().name());
        let plain = || allowed.iter().map(|name| name.trim_start_matches('!'));
        let mut attributes = Vec::with_capacity(allowed.len());
        for attribute in element.attributes() {
            let Some(name) = plain().find(|name| *name == attribute.name()) else {
                let problem = format!(
                    "has an attribute `{}`; expected {}",
                    attribute.name(),
                    plain().collect::<Vec<_>>().join(", ")
                );
                return Err(self.document.error(place, &what(), problem));
            };
            let value = self
                .parameters
                .expanded(attribute.value())
                .map_err(|problem| self.document.error(place, &what(), problem))?;
            attributes.push((name, value));
        }
        for required in allowed.iter().filter_map(|name| name.strip_prefix('!')) {
            if !attributes.iter().any(|(name, _)| *name == required) {
                return Err(self.document.error(
                    place,
                    &what(),
                    format!("has no attribute `{required}`, which is required"),
                ));
            }
        }
        Ok(Attributes(attributes))
    }

    /// Refuses elements within what has none.
    fn leaf(&self, element: Element, source: Source) -> Result<(), LoadError> {
        match element.children().find(Element::is_element) {
            None => Ok(()),
            Some(child) => Err(self.document.error(
                source.place(child),
                &format!("<{}>", child.tag_name().name()),
                format!("stands within <{}>, which has no content", element.tag_name().name()),
            )),
        }
    }

    /// Replaces the ids of references.
    fn resolve(&mut self) -> Result<(), LoadError> {
        let mut unknown = None;
        for property in self.document.nodes.iter_mut().flat_map(|node| &mut node.properties) {
            if let Value::Reference(id) = &property.value {
                match self.ids.get(id) {
                    Some(&node) => property.value = Value::Object(node),
                    None => unknown = unknown.or(Some((property.place, id.clone()))),
                }
            }
        }
        match unknown {
            None => Ok(()),
            Some((place, id)) => {
                let what = format!("<ref id=\"{id}\">");
                let nearest = super::super::value::nearest(&id, self.ids.keys().map(String::as_str));
                let hint = nearest.map_or_else(String::new, |nearest| format!("; did you mean \"{nearest}\"?"));
                Err(self
                    .document
                    .error(place, &what, format!("no object has that id{hint}")))
            }
        }
    }
}
