//! Wavefront MTL material libraries.
//!
//! A library is a hint about looks, so nothing in it is fatal: a statement that cannot be read is a warning with its
//! line, and the material keeps what could be. `tobj` has an MTL reader, but one odd line loses the whole file there
//! (`Kd 0.5` even panics), and map options stay glued to the file name; hence this reader.

use crate::material::Channel;
use crate::math::Rgb;

/// A material as its MTL file gives it; absent statements are `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MtlMaterial {
    /// The name `usemtl` refers to; not empty.
    pub name: String,
    /// The library it is from, as named after `mtllib`; map files are relative to its folder.
    pub library: String,
    /// `Kd`: diffuse reflectance; finite and not negative, but not bounded by 1.
    pub kd: Option<Rgb>,
    /// `Ks`: specular reflectance; finite and not negative.
    pub ks: Option<Rgb>,
    /// `Ns`: Phong exponent; finite and not negative.
    pub ns: Option<f32>,
    /// `Ke`: emitted radiance; finite and not negative.
    pub ke: Option<Rgb>,
    /// `Ni`: index of refraction; finite and not negative.
    pub ni: Option<f32>,
    /// `d`, or 1 - `Tr`: opacity in [0, 1]. `d` wins where both are given.
    pub d: Option<f32>,
    /// `illum`: number of the illumination model.
    pub illum: Option<u32>,
    /// `Pr`: roughness, finite and not negative.
    pub pr: Option<f32>,
    /// `Pm`: metallic weight, finite and not negative.
    pub pm: Option<f32>,
    /// Textures, by [`MapKind`].
    pub maps: [Option<MapRef>; MapKind::ALL.len()],
}

/// What a texture is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapKind {
    /// `map_Kd`: the diffuse reflectance.
    Kd,
    /// `map_d`: the opacity.
    D,
    /// `map_Ke`: the emitted radiance.
    Ke,
    /// `map_Pr`: the roughness.
    Pr,
    /// `map_Pm`: the metallic weight.
    Pm,
    /// `bump` or `map_bump`: heights; some exporters put normals there.
    Bump,
    /// `norm`: normals.
    Norm,
}

impl MapKind {
    /// All of them, as they are numbered.
    pub const ALL: [MapKind; 7] = [
        MapKind::Kd,
        MapKind::D,
        MapKind::Ke,
        MapKind::Pr,
        MapKind::Pm,
        MapKind::Bump,
        MapKind::Norm,
    ];

    /// By its keyword in lower case.
    fn named(keyword: &str) -> Option<MapKind> {
        Some(match keyword {
            "map_kd" => MapKind::Kd,
            "map_d" => MapKind::D,
            "map_ke" => MapKind::Ke,
            "map_pr" => MapKind::Pr,
            "map_pm" => MapKind::Pm,
            "bump" | "map_bump" => MapKind::Bump,
            "norm" | "map_norm" => MapKind::Norm,
            _ => return None,
        })
    }
}

impl MtlMaterial {
    /// The texture for something.
    pub fn map(&self, kind: MapKind) -> Option<&MapRef> {
        self.maps[kind as usize].as_ref()
    }
}

/// A reference to a texture file. The texture is looked up at `uv * scale + offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct MapRef {
    /// File name as written, with `/` as separator; relative to the folder of [`MtlMaterial::library`].
    pub file: String,
    /// `-s`: finite; 1 where not given.
    pub scale: [f32; 2],
    /// `-o`: finite; 0 where not given.
    pub offset: [f32; 2],
    /// `-clamp on`: beyond its edges are the texels there; else it repeats.
    pub clamp: bool,
    /// `-bm`: finite factor on heights or slopes; 1 where not given.
    pub strength: f32,
    /// `-imfchan`: which number of the texels, where one is asked for.
    pub channel: Option<Channel>,
}

impl MapRef {
    fn new() -> MapRef {
        MapRef {
            file: String::new(),
            scale: [1.0; 2],
            offset: [0.0; 2],
            clamp: false,
            strength: 1.0,
            channel: None,
        }
    }
}

/// Reads a material library. `file` names it in the warnings, which are appended to `warnings`.
///
/// Keywords are matched without regard to case. Bytes that are not UTF-8 are replaced and reported.
pub(super) fn read(file: &str, bytes: &[u8], warnings: &mut Vec<String>) -> Vec<MtlMaterial> {
    let text = String::from_utf8_lossy(bytes);
    if matches!(text, std::borrow::Cow::Owned(_)) {
        warnings.push(format!(
            "{file}: not UTF-8 text; names with other characters may not match"
        ));
    }
    let mut library = Library {
        file,
        line: 0,
        materials: Vec::new(),
        transmission: None,
        unsupported: Vec::new(),
        warnings,
    };
    for (number, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        library.line = number + 1;
        library.statement(line.trim());
    }
    library.end_material();
    for (keyword, count, line) in library.unsupported {
        library.warnings.push(format!(
            "{file}:{line}: `{keyword}` is not supported and is ignored ({count} times in the file)"
        ));
    }
    library.materials
}

/// A library being read.
struct Library<'a> {
    file: &'a str,
    line: usize,
    materials: Vec<MtlMaterial>,
    /// `Tr` of the current material, held back until it is known whether a `d` follows.
    transmission: Option<f32>,
    /// Keywords that are not supported, how often they occur, and the line of the first.
    unsupported: Vec<(String, usize, usize)>,
    warnings: &'a mut Vec<String>,
}

impl Library<'_> {
    fn warn(&mut self, what: &str) {
        let material = match self.materials.last() {
            Some(m) => format!(", material `{}`", m.name),
            None => String::new(),
        };
        self.warnings
            .push(format!("{}:{}{material}: {what}", self.file, self.line));
    }

    fn statement(&mut self, line: &str) {
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        if keyword.is_empty() || keyword.starts_with('#') {
            return;
        }
        if keyword.eq_ignore_ascii_case("newmtl") {
            self.end_material();
            if rest.is_empty() {
                self.warn("`newmtl` without a name; its statements count for the material before it");
            } else {
                self.materials.push(MtlMaterial {
                    name: rest.to_owned(),
                    library: self.file.to_owned(),
                    ..MtlMaterial::default()
                });
            }
            return;
        }
        if self.materials.is_empty() {
            self.warn(&format!("`{keyword}` before the first `newmtl` is ignored"));
            return;
        }
        let lower = keyword.to_ascii_lowercase();
        if let Some(kind) = MapKind::named(&lower) {
            if let Some(map) = self.map(keyword, rest) {
                self.set(|m| m.maps[kind as usize] = Some(map));
            }
            return;
        }
        match lower.as_str() {
            "kd" => self.set_colour(keyword, rest, |m, v| m.kd = Some(v)),
            "ks" => self.set_colour(keyword, rest, |m, v| m.ks = Some(v)),
            "ke" => self.set_colour(keyword, rest, |m, v| m.ke = Some(v)),
            "ns" => self.set_number(keyword, rest, |m, v| m.ns = Some(v)),
            "ni" => self.set_number(keyword, rest, |m, v| m.ni = Some(v)),
            "pr" => self.set_number(keyword, rest, |m, v| m.pr = Some(v)),
            "pm" => self.set_number(keyword, rest, |m, v| m.pm = Some(v)),
            "d" => {
                if let Some(d) = self.fraction(keyword, rest) {
                    self.set(|m| m.d = Some(d));
                }
            }
            "tr" => self.transmission = self.fraction(keyword, rest).or(self.transmission),
            "illum" => match rest.split_whitespace().next().and_then(|n| n.parse().ok()) {
                Some(n) => self.set(|m| m.illum = Some(n)),
                None => self.warn(&format!("`illum {rest}` is not a whole number and is ignored")),
            },
            // Ambient light does not exist in a path tracer, anti-aliasing and sharpness do not apply: nothing is lost.
            "ka" | "map_ka" | "map_aat" | "sharpness" => {}
            _ => match self.unsupported.iter_mut().find(|(k, ..)| k == keyword) {
                Some((_, count, _)) => *count += 1,
                None => self.unsupported.push((keyword.to_owned(), 1, self.line)),
            },
        }
    }

    fn end_material(&mut self) {
        let Some(transmission) = self.transmission.take() else {
            return;
        };
        match self.materials.last().and_then(|m| m.d) {
            // Exporters disagree on the sense of `Tr`, and many write it beside a correct `d`.
            Some(d) if (d - (1.0 - transmission)).abs() > 1e-3 => self.warn(&format!(
                "`d {d}` and `Tr {transmission}` contradict each other; `d` is used"
            )),
            Some(_) => {}
            None => self.set(|m| m.d = Some(1.0 - transmission)),
        }
    }

    fn set(&mut self, assign: impl FnOnce(&mut MtlMaterial)) {
        if let Some(material) = self.materials.last_mut() {
            assign(material);
        }
    }

    fn set_colour(&mut self, keyword: &str, rest: &str, assign: impl FnOnce(&mut MtlMaterial, Rgb)) {
        let values: Option<Vec<f32>> = words_of(rest).map(non_negative).collect();
        match values.as_deref() {
            Some(&[r, g, b]) => self.set(|m| assign(m, Rgb::new(r, g, b))),
            // The format lets green and blue default to red.
            Some(&[grey]) => self.set(|m| assign(m, Rgb::splat(grey))),
            _ => self.warn(&format!(
                "`{keyword} {rest}` is ignored: expected three finite numbers that are not negative"
            )),
        }
    }

    fn set_number(&mut self, keyword: &str, rest: &str, assign: impl FnOnce(&mut MtlMaterial, f32)) {
        match words_of(rest).next().and_then(non_negative) {
            Some(v) => self.set(|m| assign(m, v)),
            None => self.warn(&format!(
                "`{keyword} {rest}` is ignored: expected a finite number that is not negative"
            )),
        }
    }

    /// The number of a `d` or `Tr` statement, clamped to [0, 1].
    fn fraction(&mut self, keyword: &str, rest: &str) -> Option<f32> {
        let mut words = words_of(rest).peekable();
        if words.next_if_eq(&"-halo").is_some() {
            self.warn("`-halo` (opacity that depends on the angle) is ignored");
        }
        match words.next().and_then(|w| w.parse::<f32>().ok()) {
            Some(v) if v.is_finite() => {
                if !(0.0..=1.0).contains(&v) {
                    self.warn(&format!("`{keyword} {v}` is outside [0, 1] and is clamped"));
                }
                Some(v.clamp(0.0, 1.0))
            }
            _ => {
                self.warn(&format!("`{keyword} {rest}` is ignored: expected a number in [0, 1]"));
                None
            }
        }
    }

    /// Parses the options and the file name of a map statement.
    fn map(&mut self, keyword: &str, statement: &str) -> Option<MapRef> {
        let mut map = MapRef::new();
        let mut rest = statement;
        while let Some((option, mut after)) = split_word(rest).filter(|(word, _)| word.starts_with('-')) {
            let values = match option.to_ascii_lowercase().as_str() {
                "-s" | "-o" | "-t" => take_numbers(&mut after, 3),
                "-mm" => take_numbers(&mut after, 2),
                "-bm" | "-boost" | "-texres" | "-clamp" | "-blendu" | "-blendv" | "-cc" | "-imfchan" | "-type" => {
                    take_words(&mut after, 1)
                }
                // A file name may begin with a minus sign.
                _ => break,
            };
            self.apply_option(keyword, option, &values, &mut map);
            rest = after;
        }
        // Some exporters quote names with spaces.
        let file = rest.trim();
        let file = file.strip_prefix('"').and_then(|f| f.strip_suffix('"')).unwrap_or(file);
        if file.is_empty() {
            self.warn(&format!("`{keyword} {statement}` names no file and is ignored"));
            return None;
        }
        map.file = file.replace('\\', "/");
        Some(map)
    }

    fn apply_option(&mut self, keyword: &str, option: &str, values: &[&str], map: &mut MapRef) {
        let text = values.join(" ");
        let ignored = match option.to_ascii_lowercase().as_str() {
            kind @ ("-s" | "-o") => {
                let target = if kind == "-s" { &mut map.scale } else { &mut map.offset };
                let numbers: Vec<f32> = values.iter().filter_map(|v| v.parse().ok()).collect();
                for (t, &n) in target.iter_mut().zip(&numbers).filter(|(_, n)| n.is_finite()) {
                    *t = n;
                }
                numbers.is_empty() || numbers.iter().any(|n| !n.is_finite())
            }
            // Only where the map would look different without the option.
            "-t" => values.iter().any(|v| v.parse() != Ok(0f32)),
            "-mm" => {
                let numbers: Vec<f32> = values.iter().filter_map(|v| v.parse().ok()).collect();
                numbers != [0.0, 1.0]
            }
            "-clamp" => {
                map.clamp = text.eq_ignore_ascii_case("on");
                false
            }
            "-bm" => {
                let strength = text.parse().ok().filter(|v: &f32| v.is_finite());
                map.strength = strength.unwrap_or(map.strength);
                strength.is_none()
            }
            "-imfchan" => {
                map.channel = match text.to_ascii_lowercase().as_str() {
                    "r" => Some(Channel::R),
                    "g" => Some(Channel::G),
                    "b" => Some(Channel::B),
                    "l" => Some(Channel::Luminance),
                    _ => None,
                };
                // The matte is what opacity reads in any case.
                map.channel.is_none() && !(text.eq_ignore_ascii_case("m") && keyword.eq_ignore_ascii_case("map_d"))
            }
            "-cc" => !text.eq_ignore_ascii_case("off"),
            "-boost" => text.parse() != Ok(0f32),
            "-type" => true,
            // Blending and resolution are hints about filtering.
            _ => false,
        };
        if ignored {
            self.warn(&format!("option `{option} {text}` of `{keyword}` is ignored"));
        }
    }
}

/// The words before a comment.
fn words_of(rest: &str) -> impl Iterator<Item = &str> {
    rest.split_whitespace().take_while(|w| !w.starts_with('#'))
}

fn non_negative(word: &str) -> Option<f32> {
    word.parse().ok().filter(|v: &f32| v.is_finite() && *v >= 0.0)
}

/// The first word and what follows it.
fn split_word(text: &str) -> Option<(&str, &str)> {
    let text = text.trim_start();
    let end = text.find(char::is_whitespace).unwrap_or(text.len());
    (end > 0).then(|| text.split_at(end))
}

fn take_words<'a>(rest: &mut &'a str, most: usize) -> Vec<&'a str> {
    take_while(rest, most, |_| true)
}

fn take_numbers<'a>(rest: &mut &'a str, most: usize) -> Vec<&'a str> {
    take_while(rest, most, |word| word.parse::<f32>().is_ok())
}

/// Takes up to `most` words, but never the last one, which is the file name.
fn take_while<'a>(rest: &mut &'a str, most: usize, wanted: impl Fn(&str) -> bool) -> Vec<&'a str> {
    let mut taken = Vec::new();
    while taken.len() < most
        && let Some((word, after)) = split_word(rest)
        && wanted(word)
        && !after.trim().is_empty()
    {
        taken.push(word);
        *rest = after;
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_str(text: &str) -> (Vec<MtlMaterial>, Vec<String>) {
        let mut warnings = Vec::new();
        let materials = read("m.mtl", text.as_bytes(), &mut warnings);
        (materials, warnings)
    }

    fn map_of(statement: &str) -> (MapRef, Vec<String>) {
        let (materials, warnings) = read_str(&format!("newmtl m\nmap_Kd {statement}"));
        (materials[0].map(MapKind::Kd).cloned().expect(statement), warnings)
    }

    #[test]
    fn every_supported_statement_is_read_with_crlf_line_ends_and_comments() {
        let (materials, warnings) = read_str(
            "# library\r\nnewmtl red paint\r\nKa 1 1 1\r\n  Kd 0.5 0.25 0.125 # rose\r\nKs 0.1\r\nKe 1e1 2 3\r\nNs 96\r\n\
             Ni 1.5\r\nd 0.75\r\nillum 2\r\nPr 0.3\r\nPm 1\r\nmap_kd wood.png\r\nmap_d holes.png\r\nmap_Ke glow.png\r\nmap_Pr rough.png\r\n\
             map_Pm metal.png\r\nmap_Bump heights.png\r\nnorm normals.png\r\nnewmtl other\r\nTr 0.25",
        );
        assert_eq!(warnings, [""; 0]);
        let map = |file: &str| {
            Some(MapRef {
                file: file.to_owned(),
                ..MapRef::new()
            })
        };
        assert_eq!(
            materials[0],
            MtlMaterial {
                name: "red paint".to_owned(),
                library: "m.mtl".to_owned(),
                kd: Some(Rgb::new(0.5, 0.25, 0.125)),
                ks: Some(Rgb::splat(0.1)),
                ns: Some(96.0),
                ke: Some(Rgb::new(10.0, 2.0, 3.0)),
                ni: Some(1.5),
                d: Some(0.75),
                illum: Some(2),
                pr: Some(0.3),
                pm: Some(1.0),
                maps: [
                    map("wood.png"),
                    map("holes.png"),
                    map("glow.png"),
                    map("rough.png"),
                    map("metal.png"),
                    map("heights.png"),
                    map("normals.png"),
                ],
            }
        );
        assert_eq!(
            materials[1],
            MtlMaterial {
                name: "other".to_owned(),
                library: "m.mtl".to_owned(),
                d: Some(0.75),
                ..MtlMaterial::default()
            }
        );
    }

    #[test]
    fn the_file_name_is_what_is_left_after_the_map_options() {
        let (map, warnings) = map_of(
            "-blendu on -blendv off -bm 0.3 -clamp off -mm 0 1 -texres 512 -boost 0 -s 2 3 1 -o 0.5 -t 0 0 0 my wood.png",
        );
        assert_eq!(
            (map.file.as_str(), map.scale, map.offset),
            ("my wood.png", [2.0, 3.0], [0.5, 0.0])
        );
        assert_eq!(warnings, [""; 0]);
        // A number is the file name where nothing else follows.
        let (map, _) = map_of("-s 2 2 7");
        assert_eq!((map.file.as_str(), map.scale), ("7", [2.0, 2.0]));
        assert_eq!(map_of("-tiles.png").0.file, "-tiles.png");
        assert_eq!(map_of("\"a b.png\"").0.file, "a b.png");
    }

    #[test]
    fn options_of_maps_are_kept() {
        for keyword in ["bump", "map_bump", "map_Bump"] {
            let statement = format!("newmtl m\n{keyword} -bm -0.25 -clamp on -imfchan g a b.png");
            let (materials, warnings) = read_str(&statement);
            let map = materials[0].map(MapKind::Bump).expect(keyword);
            assert_eq!((map.file.as_str(), map.strength, map.clamp), ("a b.png", -0.25, true));
            assert_eq!((map.channel, warnings.len()), (Some(Channel::G), 0));
        }
        let (materials, warnings) = read_str("newmtl m\nmap_d -imfchan m a.png\nmap_Pr -imfchan l -clamp off a.png");
        assert_eq!(materials[0].map(MapKind::D).unwrap().channel, None);
        let roughness = materials[0].map(MapKind::Pr).unwrap();
        assert_eq!((roughness.channel, roughness.clamp), (Some(Channel::Luminance), false));
        assert_eq!(warnings, [""; 0]);
    }

    #[test]
    fn backslashes_in_file_names_become_slashes() {
        assert_eq!(map_of(r"maps\old wood\a.png").0.file, "maps/old wood/a.png");
    }

    #[test]
    fn options_that_would_change_the_look_are_warned_about() {
        for option in [
            "-mm 0.1 2",
            "-cc on",
            "-boost 3",
            "-imfchan z",
            "-imfchan m",
            "-bm x",
            "-type sphere",
            "-t 1 1 1",
        ] {
            let (map, warnings) = map_of(&format!("{option} a.png"));
            assert_eq!(map.file, "a.png", "{option}");
            assert_eq!(warnings.len(), 1, "{option}: {warnings:?}");
            assert!(
                warnings[0].starts_with("m.mtl:2, material `m`") && warnings[0].contains(option),
                "{}",
                warnings[0]
            );
        }
    }

    #[test]
    fn statements_that_cannot_be_read_are_warnings_and_the_rest_is_kept() {
        for odd in [
            "Kd 1 2",
            "Kd",
            "Kd spectral a.rfl",
            "Ks nan 0 0",
            "Ke -1 0 0",
            "Ns",
            "Ns x",
            "Ni inf",
            "d",
            "d nan",
            "Tr x",
            "illum",
            "illum -1",
            "map_Kd",
            "map_d   ",
            "map_Ke",
            "map_Ns gloss.png",
            "map_Ks b.png",
            "newmtl",
            "nonsense 1",
        ] {
            let (materials, warnings) = read_str(&format!("newmtl m\n{odd}\nPr 0.5"));
            assert_eq!(
                materials,
                [MtlMaterial {
                    name: "m".to_owned(),
                    library: "m.mtl".to_owned(),
                    pr: Some(0.5),
                    ..MtlMaterial::default()
                }],
                "{odd}"
            );
            assert!(
                warnings.len() == 1 && warnings[0].starts_with("m.mtl:2"),
                "{odd}: {warnings:?}"
            );
        }
        let (materials, warnings) = read_str("Kd 1 1 1\n");
        assert!(
            materials.is_empty() && warnings[0].contains("before the first"),
            "{warnings:?}"
        );
    }

    #[test]
    fn a_keyword_that_is_not_supported_is_reported_once() {
        let (_, warnings) = read_str("newmtl a\ndisp n.png\nnewmtl b\ndisp n.png\nTf 1 1 1\n");
        assert_eq!(warnings.len(), 2, "{warnings:?}");
        assert!(warnings[0].starts_with("m.mtl:2: `disp`") && warnings[0].contains("2 times"));
    }

    #[test]
    fn d_wins_over_a_tr_that_contradicts_it() {
        for text in ["newmtl m\nTr 1\nd 1", "newmtl m\nd 1\nTr 1\nnewmtl n"] {
            let (materials, warnings) = read_str(text);
            assert_eq!(materials[0].d, Some(1.0));
            assert!(
                warnings.len() == 1 && warnings[0].contains("contradict"),
                "{warnings:?}"
            );
        }
        let (materials, warnings) = read_str("newmtl m\nd 0.4\nTr 0.6");
        assert_eq!((materials[0].d, warnings.len()), (Some(0.4), 0));
        let (materials, warnings) = read_str("newmtl m\nd -halo 7");
        assert_eq!((materials[0].d, warnings.len()), (Some(1.0), 2));
    }

    #[test]
    fn bytes_that_are_not_text_give_warnings_only() {
        let mut warnings = Vec::new();
        let materials = read(
            "m.mtl",
            b"newmtl \xff\xfe\nmap_Kd \x00\x80 -s\nKd \xc3\n-\n",
            &mut warnings,
        );
        assert_eq!(materials.len(), 1);
        assert!(warnings[0].contains("UTF-8"), "{warnings:?}");
    }
}
