//! How much memory there is, so that what cannot fit is refused, or made in less, before it is begun.

use std::fs;
use std::path::Path;

/// Where Linux tells the limits of groups of processes, in which containers and jobs run: of both versions the folder,
/// what begins the line of the group, and the files of the limit and of what is taken, and the entry of what of this can
/// be given back.
const GROUPS: [(&str, &str, [&str; 3]); 2] = [
    ("/sys/fs/cgroup", "0::", ["memory.max", "memory.current", "inactive_file "]),
    (
        "/sys/fs/cgroup/memory",
        ":memory:",
        ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file "],
    ),
];

/// Limits of a process (`ulimit -d`, `ulimit -v`), and what they limit.
const LIMITS: [(&str, &str); 2] = [("Max data size", "VmData:"), ("Max address space", "VmSize:")];

/// Bytes of memory that this process may still take, where the system tells it: what is free, and no more than a limit
/// of the process or of a group that it is in leaves.
pub fn available() -> Option<u64> {
    let free = kilobytes(&read("/proc/meminfo")?, "MemAvailable:")?;
    Some([of_groups(), of_process()].into_iter().flatten().fold(free, u64::min))
}

/// Bytes of memory that this process has taken for its data, where the system tells it. The program's code is none of them:
/// `ulimit -d` does not count it, and it leaves no room for data.
pub fn taken() -> Option<u64> {
    kilobytes(&read("/proc/self/status")?, "RssAnon:")
}

/// Whether so many numbers of eight bytes are more than the free memory: the bytes that they take, and those that
/// are free, if so.
pub fn exceeds(numbers: u128) -> Option<(u128, u64)> {
    let (bytes, free) = (numbers.saturating_mul(8), available()?);
    (bytes > u128::from(free)).then_some((bytes, free))
}

/// What the limits of the process leave.
fn of_process() -> Option<u64> {
    let (limits, status) = (read("/proc/self/limits")?, read("/proc/self/status")?);
    let left = |(limit, taken): (&str, &str)| {
        Some(number(after(&limits, limit)?)?.saturating_sub(kilobytes(&status, taken)?))
    };
    LIMITS.into_iter().filter_map(left).min()
}

/// What the limits of its groups leave.
fn of_groups() -> Option<u64> {
    let groups = read("/proc/self/cgroup")?;
    let own = |(folder, begin, files): (&str, &str, [&str; 3])| {
        let path = groups.lines().find_map(|line| line.split_once(begin))?.1;
        // the limits of all above count too; in a container the path may be one that is not seen from inside
        let folders = Path::new(path).ancestors();
        let below = |path: &Path| Path::new(folder).join(path.strip_prefix("/").unwrap_or(path));
        folders.filter_map(|path| left_in(&below(path), files)).min()
    };
    GROUPS.into_iter().filter_map(own).min()
}

/// What the limit of a group leaves; nothing where it has none.
fn left_in(folder: &Path, [limit, taken, returned]: [&str; 3]) -> Option<u64> {
    let [limit, taken] = [limit, taken].map(|file| number(&read(folder.join(file))?));
    // files that were read count as taken until the memory is needed
    let returned =
        read(folder.join("memory.stat")).and_then(|stat| number(after(&stat, returned)?));
    Some(limit?.saturating_sub(taken?.saturating_sub(returned.unwrap_or(0))))
}

fn read(path: impl AsRef<Path>) -> Option<String> {
    fs::read_to_string(path).ok()
}

/// The rest of the line that begins so.
fn after<'t>(text: &'t str, begin: &str) -> Option<&'t str> {
    text.lines().find_map(|line| line.strip_prefix(begin))
}

/// The first word, where it is a number.
fn number(text: &str) -> Option<u64> {
    text.split_whitespace().next()?.parse().ok()
}

fn kilobytes(text: &str, begin: &str) -> Option<u64> {
    Some(number(after(text, begin)?)? << 10)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn this_process_takes_memory_and_may_take_more() {
        assert!(taken().unwrap() > 1 << 20);
        assert!(available().unwrap() > 1 << 20);
        assert!(exceeds(1 << 100).is_some() && exceeds(1).is_none());
    }

    #[test]
    fn a_group_leaves_its_limit_less_what_is_taken_for_good() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
        let files = GROUPS[0].2;
        assert_eq!(left_in(folder.path(), files), None);
        write("memory.max", "max\n");
        write("memory.current", "600\n");
        assert_eq!(left_in(folder.path(), files), None);
        write("memory.max", "1000\n");
        assert_eq!(left_in(folder.path(), files), Some(400));
        write("memory.stat", "active_file 7\ninactive_file 50\n");
        assert_eq!(left_in(folder.path(), files), Some(450));
        write("memory.current", "2000\n");
        assert_eq!(left_in(folder.path(), files), Some(0));
    }
}
