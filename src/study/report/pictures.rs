//! Images side by side: two behind a slider, and all of them as a gallery that paper shows as well.

use super::format::number;
use crate::study::reference::Target;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, html};

/// An image of the report.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Part of its name in the page.
    pub id: String,
    /// For people.
    pub title: String,
    /// What light it has.
    pub target: Target,
    /// Mean FLIP against the reference; `None` for the reference.
    pub flip: Option<f64>,
    /// The file; `None` if it is lost.
    pub png: Option<Vec<u8>>,
    /// The map of FLIP errors.
    pub flip_png: Option<Vec<u8>>,
}

fn data_uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(png))
}

/// Slider and gallery.
pub(super) fn section(pictures: &[Picture]) -> Markup {
    let shown: Vec<&Picture> = pictures.iter().filter(|p| p.png.is_some()).collect();
    // The reference first, and the default beside it.
    let chosen = [
        shown.first().map(|p| &p.id),
        shown.iter().find(|p| p.flip.is_some()).map(|p| &p.id),
    ];
    let options = |chosen: Option<&String>| {
        html! {
            @for picture in &shown {
                option value=(picture.id) selected[Some(&picture.id) == chosen] { (picture.title) }
            }
        }
    };
    html! {
        h2 { "Images" }
        div.interactive #compare {
            div.controls {
                label { "left " select #left { (options(chosen[0])) } }
                label { "right " select #right { (options(chosen[1])) } }
            }
            div.compare {
                figure {
                    div.stack {
                        img.left alt="left image";
                        img.right alt="right image";
                        div.line {}
                    }
                    input #split type="range" min="0" max="100" value="50" step="0.5" aria-label="where the right image begins";
                }
                figure.flip {
                    img alt="FLIP errors of the right image";
                    figcaption { "FLIP errors of the right image against its reference" (scale()) }
                }
            }
        }
        p.faint { "Each image beside its FLIP errors: what a person would notice when flipping between it and the reference." }
        div.gallery {
            @for picture in shown {
                figure {
                    div.pair {
                        img id=(format!("image-{}", picture.id)) alt=(picture.title)
                            src=(data_uri(picture.png.as_deref().unwrap_or_default()));
                        @if let Some(flip) = &picture.flip_png {
                            img id=(format!("flip-{}", picture.id)) alt=(format!("FLIP errors: {}", picture.title))
                                src=(data_uri(flip));
                        }
                    }
                    figcaption { (picture.title) @if let Some(flip) = picture.flip { ": FLIP " (number(flip)) } }
                }
            }
        }
    }
}

/// What the colours of FLIP mean.
fn scale() -> Markup {
    html! {
        div.scale {}
        div.ends { span { "0: none" } span { "1: largest" } }
    }
}
