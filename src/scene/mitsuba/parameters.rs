//! Parameters of a scene, which stand for text in attributes.

/// Bytes that parameters may expand to, in all: a parameter of two others would double with each.
const MAX_EXPANSION: usize = 1 << 24;

/// A parameter and its value.
pub(super) struct Parameter {
    pub(super) name: String,
    pub(super) value: String,
    is_used: bool,
}

/// All that have a value so far.
#[derive(Default)]
pub(super) struct Parameters {
    /// The longest name first, so that `$ab` is not `$a` and a letter.
    all: Vec<Parameter>,
    expansion: usize,
}

impl Parameters {
    /// One that should have been used and was not.
    pub(super) fn unused(&self) -> Option<&Parameter> {
        self.all.iter().find(|parameter| !parameter.is_used)
    }

    /// The text with the values of parameters in place of `$` and their names; `\$` is a dollar sign.
    pub(super) fn expanded(&mut self, text: &str) -> Result<String, String> {
        let mut expanded = String::with_capacity(text.len());
        let mut rest = text;
        while let Some(at) = rest.find('$') {
            let (before, after) = (&rest[..at], &rest[at + 1..]);
            if let Some(before) = before.strip_suffix('\\') {
                expanded += before;
                expanded.push('$');
                rest = after;
                continue;
            }
            let Some(parameter) = self.all.iter_mut().find(|p| after.starts_with(&p.name)) else {
                let name: String = after.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                return Err(format!(
                    "${name} has no value; write <default name=\"{name}\" value=\"...\"/> before it or use -D {name}=..."
                ));
            };
            parameter.is_used = true;
            self.expansion += parameter.value.len();
            if self.expansion > MAX_EXPANSION {
                return Err(format!("parameters expand to more than {MAX_EXPANSION} bytes"));
            }
            expanded += before;
            expanded += &parameter.value;
            rest = &after[parameter.name.len()..];
        }
        Ok(expanded + rest)
    }

    /// Gives a parameter a value unless it has one. `is_used`: nobody has to use it.
    pub(super) fn add(&mut self, name: &str, value: &str, is_used: bool) {
        if !name.is_empty() && !self.all.iter().any(|parameter| parameter.name == name) {
            let at = self.all.partition_point(|parameter| parameter.name.len() >= name.len());
            let parameter = Parameter {
                name: name.to_owned(),
                value: value.to_owned(),
                is_used,
            };
            self.all.insert(at, parameter);
        }
    }
}
