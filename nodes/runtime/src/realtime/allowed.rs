//! What the system allows a process in real time, and how to have it allow more.
//!
//! Place in the flow: under [`super::Realtime`], whose refusals it words.

use std::fs;

use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_getaffinity};

/// Cores that the kernel has started.
const ONLINE: &str = "/sys/devices/system/cpu/online";
/// Users in the user namespace that the system began with.
const WHOLE: &str = "4294967295";

/// The cores of this machine; where it does not say, those that this process may use.
#[must_use]
pub fn online_cores() -> Vec<usize> {
    let said = fs::read_to_string(ONLINE).ok();
    said.and_then(|text| cores_of(&text)).unwrap_or_else(allowed_cores)
}

/// The cores that this thread may use.
pub(super) fn allowed_cores() -> Vec<usize> {
    let set = sched_getaffinity(None).unwrap_or_default();
    (0..CpuSet::MAX_CPU).filter(|core| set.is_set(*core)).collect()
}

/// `0-3,6` as a list.
fn cores_of(text: &str) -> Option<Vec<usize>> {
    let mut cores = Vec::new();
    for part in text.trim().split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last): (usize, usize) = (first.parse().ok()?, last.parse().ok()?);
        if last >= CpuSet::MAX_CPU {
            return None;
        }
        cores.extend(first..=last);
    }
    Some(cores)
}

/// Why this process may not lock its memory; nothing where it may.
///
/// A limit is refused, however large: with all future memory locked, the first allocation beyond it would end the node in the
/// middle of its work.
pub(super) fn may_lock_memory() -> Result<(), String> {
    match getrlimit(Resource::Memlock).current {
        Some(bytes) if !has_capability(CapabilitySet::IPC_LOCK) => {
            let kib = bytes / 1024;
            Err(format!("RLIMIT_MEMLOCK is {kib} KiB, must be unlimited, and there is no CAP_IPC_LOCK"))
        }
        _ => Ok(()),
    }
}

/// Why a priority was refused.
pub(super) fn why_no_priority(priority: u8) -> String {
    let limit = getrlimit(Resource::Rtprio).current;
    match limit.filter(|limit| *limit < u64::from(priority)) {
        Some(limit) => format!("RLIMIT_RTPRIO is {limit}, and there is no CAP_SYS_NICE"),
        None if has_capability(CapabilitySet::SYS_NICE) => {
            "CAP_SYS_NICE is there, but a control group or a filter of system calls forbids it".to_owned()
        }
        None => "a control group or a filter of system calls forbids it".to_owned(),
    }
}

/// The words that say how to have both.
pub(super) fn how_to_grant(priority: u8) -> String {
    let program = std::env::current_exe().map_or_else(|_| "abbe".to_owned(), |path| path.display().to_string());
    format!(
        "Grant priority and memory by one of these, or leave out realtime: the lines \"USER - rtprio {priority}\" and \"USER - \
         memlock unlimited\" in /etc/security/limits.d/abbe.conf, and a new login of that USER; LimitRTPRIO={priority} and \
         LimitMEMLOCK=infinity in the systemd unit; sudo setcap cap_sys_nice,cap_ipc_lock=ep {program}; for a container \
         --ulimit rtprio={priority} --ulimit memlock=-1, as root --cap-add=SYS_NICE --cap-add=IPC_LOCK"
    )
}

/// Whether this thread has a capability, in a user namespace where it counts.
fn has_capability(capability: CapabilitySet) -> bool {
    let namespace = fs::read_to_string("/proc/self/uid_map").unwrap_or_default();
    capabilities(None).is_ok_and(|sets| sets.effective.contains(capability)) && is_whole(&namespace)
}

/// Whether this user namespace is the one that the system began with: in another one these capabilities do not count.
fn is_whole(namespace: &str) -> bool {
    namespace.split_whitespace().nth(2) == Some(WHOLE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_are_read_as_the_kernel_writes_them() {
        assert_eq!(cores_of("0-3,6\n"), Some(vec![0, 1, 2, 3, 6]));
        assert_eq!(cores_of("0\n"), Some(vec![0]));
        assert_eq!([cores_of(""), cores_of("0-x"), cores_of("0-99999999999")], [None, None, None]);
        assert!(!online_cores().is_empty());
    }

    #[test]
    fn a_capability_counts_in_the_namespace_of_the_system_alone() {
        assert!(is_whole("         0          0 4294967295\n"));
        assert!(!is_whole("         0       1000          1\n") && !is_whole(""));
    }

    #[test]
    fn who_is_refused_reads_each_way_to_be_allowed() {
        let words = how_to_grant(50);
        for way in ["limits.d", "rtprio 50", "memlock unlimited", "setcap", "LimitRTPRIO=50", "LimitMEMLOCK=infinity"] {
            assert!(words.contains(way), "{words} lacks {way}");
        }
    }
}
