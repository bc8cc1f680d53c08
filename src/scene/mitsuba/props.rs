//! The parameters of an object, taken one by one; what nobody has taken in the end is an error.

use super::super::load::LoadError;
use super::super::value::nearest;
use super::document::{Document, Node, Place, Property, Tag, Value};
use super::transform;
use crate::math::{DAffine3, DVec3};

/// The parameters of an object.
pub(super) struct Props<'a> {
    pub(super) document: &'a Document,
    pub(super) node: &'a Node,
    is_taken: Vec<bool>,
    /// All that have been asked for.
    known: Vec<&'static str>,
}

impl<'a> Props<'a> {
    pub(super) fn new(document: &'a Document, node: usize) -> Props<'a> {
        let node = &document.nodes[node];
        Props {
            document,
            node,
            is_taken: vec![false; node.properties.len()],
            known: Vec::new(),
        }
    }

    /// The object in messages.
    pub(super) fn label(&self) -> String {
        label(self.node)
    }

    /// An error about the object.
    pub(super) fn error(&self, problem: impl Into<String>) -> LoadError {
        self.document.error(self.node.place, &self.label(), problem)
    }

    /// An error about one of its parameters.
    pub(super) fn error_at(&self, property: &Property, problem: impl Into<String>) -> LoadError {
        self.wrong(property.place, &property.name, problem)
    }

    fn wrong(&self, place: Place, name: &str, problem: impl Into<String>) -> LoadError {
        let what = format!("parameter \"{name}\" of {}", self.label());
        self.document.error(place, &what, problem)
    }

    /// Takes a parameter of any kind.
    pub(super) fn take(&mut self, name: &'static str) -> Option<&'a Property> {
        self.known.push(name);
        let at = self.node.properties.iter().position(|property| property.name == name)?;
        self.is_taken[at] = true;
        Some(&self.node.properties[at])
    }

    fn take_as<T>(
        &mut self,
        name: &'static str,
        expected: &str,
        convert: impl FnOnce(&'a Value) -> Option<T>,
    ) -> Result<Option<T>, LoadError> {
        let Some(property) = self.take(name) else {
            return Ok(None);
        };
        match convert(&property.value) {
            Some(value) => Ok(Some(value)),
            None => Err(self.error_at(property, format!("is not a {expected}; expected <{expected}>"))),
        }
    }

    pub(super) fn boolean(&mut self, name: &'static str, default: bool) -> Result<bool, LoadError> {
        let value = self.take_as(name, "boolean", |value| match value {
            Value::Boolean(b) => Some(*b),
            _ => None,
        })?;
        Ok(value.unwrap_or(default))
    }

    pub(super) fn integer(&mut self, name: &'static str) -> Result<Option<i64>, LoadError> {
        self.take_as(name, "integer", |value| match value {
            Value::Integer(i) => Some(*i),
            _ => None,
        })
    }

    pub(super) fn float(&mut self, name: &'static str) -> Result<Option<f64>, LoadError> {
        self.take_as(name, "float", |value| match value {
            Value::Float(f) => Some(*f),
            Value::Integer(i) => Some(*i as f64),
            _ => None,
        })
    }

    /// A number within bounds.
    pub(super) fn float_in(
        &mut self,
        name: &'static str,
        default: f64,
        bounds: impl std::ops::RangeBounds<f64> + std::fmt::Debug,
    ) -> Result<f64, LoadError> {
        let value = self.float(name)?.unwrap_or(default);
        if bounds.contains(&value) {
            return Ok(value);
        }
        let place = self.node.properties.iter().find(|property| property.name == name);
        let place = place.map_or(self.node.place, |property| property.place);
        Err(self.wrong(place, name, format!("{value} is not in {bounds:?}")))
    }

    pub(super) fn string(&mut self, name: &'static str) -> Result<Option<&'a str>, LoadError> {
        self.take_as(name, "string", |value| match value {
            Value::String(s) => Some(s.as_str()),
            _ => None,
        })
    }

    /// One of some words.
    pub(super) fn word<T: Copy>(
        &mut self,
        name: &'static str,
        words: &[(&str, T)],
        default: T,
    ) -> Result<T, LoadError> {
        let Some(word) = self.string(name)? else {
            return Ok(default);
        };
        match words.iter().find(|(known, _)| known.eq_ignore_ascii_case(word)) {
            Some((_, value)) => Ok(*value),
            None => {
                let known: Vec<&str> = words.iter().map(|(known, _)| *known).collect();
                let problem = format!(
                    "\"{word}\" of parameter \"{name}\" is not supported; expected {}",
                    known.join(", ")
                );
                Err(self.error(problem))
            }
        }
    }

    pub(super) fn vector(&mut self, name: &'static str) -> Result<Option<DVec3>, LoadError> {
        self.take_as(name, "vector", |value| match value {
            Value::Vector(v) => Some(*v),
            _ => None,
        })
    }

    /// A transform of texture coordinates or of space.
    pub(super) fn matrix(&mut self, name: &'static str) -> Result<Option<crate::math::DMat4>, LoadError> {
        self.take_as(name, "transform", |value| match value {
            Value::Transform(m) => Some(*m),
            _ => None,
        })
    }

    /// Takes `to_world`, which is the identity where it is absent.
    pub(super) fn take_to_world(&mut self) -> Result<DAffine3, LoadError> {
        match self.matrix("to_world")? {
            None => Ok(DAffine3::IDENTITY),
            Some(matrix) => transform::affine(&matrix).map_err(|problem| {
                let problem = format!("its to_world {problem}");
                self.error(problem)
            }),
        }
    }

    /// Takes the children of a kind, whatever their names.
    pub(super) fn children(&mut self, tag: Tag) -> Vec<usize> {
        let mut found = Vec::new();
        for (property, is_taken) in self.node.properties.iter().zip(&mut self.is_taken) {
            if let Value::Object(node) = property.value
                && self.document.nodes[node].tag == tag
                && !*is_taken
            {
                *is_taken = true;
                found.push(node);
            }
        }
        found
    }

    /// Takes the child of a kind, of which there may be one.
    pub(super) fn child(&mut self, tag: Tag) -> Result<Option<usize>, LoadError> {
        match self.children(tag)[..] {
            [] => Ok(None),
            [child] => Ok(Some(child)),
            [_, second, ..] => Err(self.document.error(
                self.document.nodes[second].place,
                &label(&self.document.nodes[second]),
                format!(
                    "is the second <{}> of {}, which has one at most",
                    tag.element(),
                    self.label()
                ),
            )),
        }
    }

    /// Takes parameters that have no effect here.
    pub(super) fn ignore(&mut self, names: &[&'static str]) {
        for name in names {
            self.take(name);
        }
    }

    /// Refuses parameters and children that nobody has taken.
    pub(super) fn finish(self) -> Result<(), LoadError> {
        let Some(at) = self.is_taken.iter().position(|is_taken| !is_taken) else {
            return Ok(());
        };
        let property = &self.node.properties[at];
        if let Value::Object(child) = property.value
            && property.name.is_empty()
        {
            let child = &self.document.nodes[child];
            let problem = format!("is not supported within {}", self.label());
            return Err(self.document.error(property.place, &label(child), problem));
        }
        let mut known = self.known.clone();
        known.sort_unstable();
        known.dedup();
        let hint = nearest(&property.name, known.iter().copied());
        let hint = hint.map_or_else(String::new, |name| format!("; did you mean \"{name}\"?"));
        let expected = if known.is_empty() {
            "none".to_owned()
        } else {
            known.join(", ")
        };
        let problem = format!("is not supported{hint} Supported: {expected}");
        Err(self.error_at(property, problem.replace("supported Supported", "supported. Supported")))
    }
}

/// An object in messages.
pub(super) fn label(node: &Node) -> String {
    if node.tag == Tag::Scene {
        return "<scene>".into();
    }
    format!("<{} type=\"{}\">", node.tag.element(), node.plugin)
}
