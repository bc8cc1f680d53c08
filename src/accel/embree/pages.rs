//! Large pages for what rays read.
//!
//! A ray visits a tree and a mesh at places that have nothing to do with each other, and with pages of 4 KiB most of these
//! visits first wait for the address to be translated. Embree asks for large pages itself where a tree takes hundreds of
//! megabytes. Smaller ones lie in the C library's heap, like our meshes and textures, which takes large pages only if it is
//! told to before the program starts; so the system is asked to make them of what is there.

use std::fs;

/// Size of a large page: that of x86-64, and of arm64 with small pages of 4 KiB.
const LARGE_PAGE: usize = 2 << 20;

/// Where the owner of the system says which programs get large pages.
const POLICY: &str = "/sys/kernel/mm/transparent_hugepage/enabled";

/// Makes large pages of the memory that the process has written so far. Where the system cannot, or its owner wants none, all
/// stays as it is.
pub(super) fn enlarge() {
    // The request would override it.
    if fs::read_to_string(POLICY).is_ok_and(|policy| policy.contains("[never]")) {
        return;
    }
    let Ok(maps) = fs::read_to_string("/proc/self/maps") else {
        return;
    };
    for (start, end) in maps.lines().filter_map(own_memory) {
        let start = start.next_multiple_of(LARGE_PAGE);
        let end = end / LARGE_PAGE * LARGE_PAGE;
        if start < end {
            let address = std::ptr::with_exposed_provenance_mut(start);
            // SAFETY: the advice changes neither contents nor access, whoever the memory belongs to. If the mapping is gone by
            // now, the call fails.
            let _ = unsafe { libc::madvise(address, end - start, libc::MADV_COLLAPSE) };
        }
    }
}

/// The range of a line of the list of mappings, if it is private memory to read and write without a file.
fn own_memory(line: &str) -> Option<(usize, usize)> {
    let mut words = line.split_ascii_whitespace();
    let (range, access) = (words.next()?, words.next()?);
    let (_offset, _device, inode) = (words.next()?, words.next()?, words.next()?);
    let is_heap = matches!(words.next(), None | Some("[heap]"));
    if access != "rw-p" || inode != "0" || !is_heap {
        return None;
    }
    let (start, end) = range.split_once('-')?;
    let number = |digits| usize::from_str_radix(digits, 16).ok();
    Some((number(start)?, number(end)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_memory_of_the_process_itself_is_asked_for() {
        assert_eq!(own_memory("7f00-9f00 rw-p 00000000 00:00 0 "), Some((0x7f00, 0x9f00)));
        assert_eq!(
            own_memory("5000-6000 rw-p 00000000 00:00 0    [heap]"),
            Some((0x5000, 0x6000))
        );
        for other in [
            "7f00-9f00 r--p 00000000 00:00 0",
            "7f00-9f00 rw-s 00000000 00:00 0",
            "7f00-9f00 rw-p 00000000 fe:00 17   /usr/lib/libembree3.so",
            "7f00-9f00 rw-p 00000000 00:00 0    [stack]",
            "no range at all",
            "",
        ] {
            assert_eq!(own_memory(other), None, "{other}");
        }
    }

    #[test]
    fn contents_stay() {
        let numbers: Vec<u32> = (0..4 << 20).collect();
        enlarge();
        assert!(numbers.iter().zip(0..).all(|(number, i)| *number == i));
    }
}
