//! Arrays of numbers in buffers. Everything is checked when one is opened; reading it cannot fail.

use super::resource::Buffers;
use super::{Asset, LoadError};
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;

/// Most elements of an accessor that has no bytes of its own: all zeros, or sparse.
const MOST_ZEROS: u64 = 1 << 20;

/// Elements a fixed number of bytes apart.
#[derive(Clone, Copy, Debug)]
struct Strided<'a> {
    bytes: &'a [u8],
    stride: usize,
}

impl<'a> Strided<'a> {
    /// `count` elements of `size` bytes in a view; `key` is for messages.
    fn new(
        asset: &Asset<'_>,
        buffers: &'a Buffers<'_>,
        (view, offset): (usize, u64),
        (count, size): (u64, usize),
        key: &str,
    ) -> Result<Strided<'a>, LoadError> {
        let bytes = buffers.view(asset, view)?;
        let stride = asset.root.buffer_views[view]
            .byte_stride
            .map_or(size, |stride| stride.0);
        if stride < size {
            return Err(asset.error(
                format!("bufferViews[{view}].byteStride"),
                format!("{stride} is less than the {size} bytes of an element of {key}"),
            ));
        }
        let end = (count - 1)
            .checked_mul(stride as u64)
            .and_then(|last| last.checked_add(offset)?.checked_add(size as u64));
        if end.is_none_or(|end| end > bytes.len() as u64) {
            return Err(asset.error(
                key,
                format!(
                    "{count} elements of {size} bytes, {stride} apart, from byte {offset} on are not within bufferViews[{view}], \
                     which has {} bytes",
                    bytes.len()
                ),
            ));
        }
        Ok(Strided {
            bytes: &bytes[offset as usize..],
            stride,
        })
    }

    fn element(&self, index: usize) -> &'a [u8] {
        &self.bytes[index * self.stride..]
    }
}

/// An array of vectors or of single numbers.
#[derive(Debug)]
pub(super) struct Accessor<'a> {
    /// Elements; at least one.
    pub(super) count: usize,
    /// Numbers of an element.
    pub(super) components: usize,
    component: ComponentType,
    normalized: bool,
    /// All zeros without.
    base: Option<Strided<'a>>,
    /// Growing indices of elements that are replaced, and what by.
    sparse: Option<(Vec<u32>, Strided<'a>)>,
}

/// Elements of an accessor as the file states it, and those of them that are replaced.
pub(super) fn stated_counts(asset: &Asset<'_>, index: usize) -> (u64, u64) {
    let accessor = &asset.root.accessors[index];
    let sparse = accessor.sparse.as_ref().map_or(0, |sparse| sparse.count.0);
    (accessor.count.0, sparse)
}

impl<'a> Accessor<'a> {
    /// `allowed`: numbers of an element that there may be.
    pub(super) fn open(
        asset: &Asset<'_>,
        buffers: &'a Buffers<'_>,
        index: usize,
        allowed: &[usize],
    ) -> Result<Accessor<'a>, LoadError> {
        let json = &asset.root.accessors[index];
        let key = format!("accessors[{index}]");
        let (Checked::Valid(component), Checked::Valid(shape)) = (json.component_type, json.type_) else {
            return Err(asset.error(key, "has a component type or a type that glTF 2.0 does not have"));
        };
        let component = component.0;
        let components = match shape {
            Type::Scalar => 1,
            Type::Vec2 => 2,
            Type::Vec3 => 3,
            Type::Vec4 => 4,
            // Columns of bytes are padded; nothing that is read has them.
            Type::Mat2 | Type::Mat3 | Type::Mat4 => 0,
        };
        if !allowed.contains(&components) {
            return Err(asset.error(
                format!("{key}.type"),
                format!("{shape:?} is not what is used here; elements of {allowed:?} numbers are"),
            ));
        }
        let size = components * component.size();
        let count = json.count.0;
        if count == 0 {
            return Err(asset.error(format!("{key}.count"), "is 0; an accessor has an element at least"));
        }
        let base = match json.buffer_view {
            Some(view) => {
                let offset = json.byte_offset.unwrap_or_default().0;
                Some(Strided::new(
                    asset,
                    buffers,
                    (view.value(), offset),
                    (count, size),
                    &key,
                )?)
            }
            None if count > MOST_ZEROS.max(buffers.total() as u64) => {
                return Err(asset.error(
                    format!("{key}.count"),
                    format!("{count} elements without a buffer view are more than the file can mean"),
                ));
            }
            None => None,
        };
        let sparse = match &json.sparse {
            Some(sparse) => Some(replaced(asset, buffers, sparse, (count, size), &key)?),
            None => None,
        };
        Ok(Accessor {
            count: count as usize,
            components,
            component,
            normalized: json.normalized,
            base,
            sparse,
        })
    }

    fn element(&self, index: usize) -> Option<&'a [u8]> {
        let sparse = self.sparse.as_ref().and_then(|(indices, values)| {
            let at = indices.binary_search(&(index as u32)).ok()?;
            Some(values.element(at))
        });
        sparse.or_else(|| Some(self.base?.element(index)))
    }

    /// The first `N` numbers of an element, [`Accessor::components`] at most; integers that are normalised in [-1, 1].
    pub(super) fn floats<const N: usize>(&self, index: usize) -> [f32; N] {
        let Some(bytes) = self.element(index) else {
            return [0.0; N];
        };
        let normal = |value: f32, largest: f32| if self.normalized { value / largest } else { value };
        std::array::from_fn(|i| match self.component {
            ComponentType::I8 => {
                normal(f32::from(bytes[i] as i8), 127.0).max(if self.normalized { -1.0 } else { -128.0 })
            }
            ComponentType::U8 => normal(f32::from(bytes[i]), 255.0),
            ComponentType::I16 => {
                let value = i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
                normal(value.into(), 32767.0).max(if self.normalized { -1.0 } else { -32768.0 })
            }
            ComponentType::U16 => {
                let value = u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
                normal(value.into(), 65535.0)
            }
            ComponentType::U32 => four(bytes, i, u32::from_le_bytes) as f32,
            ComponentType::F32 => four(bytes, i, f32::from_le_bytes),
        })
    }

    /// Whether elements are what vertices are numbered by.
    pub(super) fn is_unsigned(&self) -> bool {
        matches!(
            self.component,
            ComponentType::U8 | ComponentType::U16 | ComponentType::U32
        )
    }

    /// The first number of an element, of an accessor of unsigned integers; 0 of others.
    pub(super) fn integer(&self, index: usize) -> u32 {
        let Some(bytes) = self.element(index) else {
            return 0;
        };
        match self.component {
            ComponentType::U8 => bytes[0].into(),
            ComponentType::U16 => u16::from_le_bytes([bytes[0], bytes[1]]).into(),
            ComponentType::U32 => four(bytes, 0, u32::from_le_bytes),
            ComponentType::I8 | ComponentType::I16 | ComponentType::F32 => 0,
        }
    }
}

fn four<T>(bytes: &[u8], i: usize, from: impl Fn([u8; 4]) -> T) -> T {
    from(std::array::from_fn(|b| bytes[4 * i + b]))
}

/// Indices and values of a sparse accessor of `count` elements of `size` bytes.
fn replaced<'a>(
    asset: &Asset<'_>,
    buffers: &'a Buffers<'_>,
    sparse: &gltf::json::accessor::sparse::Sparse,
    (count, size): (u64, usize),
    key: &str,
) -> Result<(Vec<u32>, Strided<'a>), LoadError> {
    let some = sparse.count.0;
    if some == 0 || some > count {
        return Err(asset.error(
            format!("{key}.sparse.count"),
            format!("{some} is not within 1 and the {count} of the accessor"),
        ));
    }
    let Checked::Valid(index_type) = sparse.indices.component_type else {
        return Err(asset.error(
            format!("{key}.sparse.indices.componentType"),
            "is none of unsigned integers",
        ));
    };
    let index_type = index_type.0;
    let at = (sparse.indices.buffer_view.value(), sparse.indices.byte_offset.0);
    let key_of_indices = format!("{key}.sparse.indices");
    let indices = Strided::new(asset, buffers, at, (some, index_type.size()), &key_of_indices)?;
    let indices = Accessor {
        count: some as usize,
        components: 1,
        component: index_type,
        normalized: false,
        base: Some(indices),
        sparse: None,
    };
    let indices: Vec<u32> = (0..indices.count).map(|i| indices.integer(i)).collect();
    if let Some(i) = indices.windows(2).position(|pair| pair[0] >= pair[1]) {
        return Err(asset.error(
            key_of_indices,
            format!(
                "index {} is {}, but they must grow, and it follows {}",
                i + 1,
                indices[i + 1],
                indices[i]
            ),
        ));
    }
    if let Some(&last) = indices.last().filter(|&&last| u64::from(last) >= count) {
        return Err(asset.error(key_of_indices, format!("{last} is beyond the {count} elements")));
    }
    let at = (sparse.values.buffer_view.value(), sparse.values.byte_offset.0);
    let values = Strided::new(asset, buffers, at, (some, size), &format!("{key}.sparse.values"))?;
    Ok((indices, values))
}
