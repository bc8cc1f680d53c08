//! What the system tells of the machine.

/// Half of the memory that could be had without swapping; `None` where the system does not tell.
pub(super) fn available_memory() -> Option<u64> {
    let meminfo = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kibibytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kibibytes * 1024 / 2)
}

/// Level and bytes of the first processor's caches for data.
pub(super) fn caches() -> Vec<(u32, u64)> {
    let read = |index: u32, what: &str| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/{what}");
        std::fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
    };
    let cache = |index| {
        let is_data = read(index, "type")? != "Instruction";
        let kibibytes: u64 = read(index, "size")?.strip_suffix('K')?.parse().ok()?;
        is_data.then_some((read(index, "level")?.parse().ok()?, kibibytes * 1024))
    };
    (0..8).filter_map(cache).collect()
}
