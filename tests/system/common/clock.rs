//! Another system clock for the programs of a test: a library that they load shifts it.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use super::files::Bench;

/// Shifts the system clock of the programs that load it by as many seconds as the file `CLOCK_OFFSET_FILE` says now.
const SOURCE: &str = "
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>
int clock_gettime(clockid_t id, struct timespec *t) {
  static int (*real)(clockid_t, struct timespec *);
  if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, \"clock_gettime\");
  int result = real(id, t);
  const char *file = getenv(\"CLOCK_OFFSET_FILE\");
  if (result != 0 || id != CLOCK_REALTIME || !file) return result;
  char text[32] = {0};
  int offset = open(file, O_RDONLY | O_CLOEXEC);
  if (offset >= 0) {
    if (read(offset, text, sizeof text - 1) > 0) t->tv_sec += atoll(text);
    close(offset);
  }
  return result;
}
";

/// The clock of those programs that [`ShiftedClock::hold`] was called for.
pub(crate) struct ShiftedClock {
    library: PathBuf,
    offset: PathBuf,
}

impl ShiftedClock {
    /// None, said aloud, where there is no C compiler.
    pub(crate) fn new(bench: &Bench) -> Option<ShiftedClock> {
        let library = preloaded(bench, "clock", SOURCE)?;
        let clock = ShiftedClock { library, offset: bench.path("clock_offset_s") };
        clock.set(0);
        Some(clock)
    }

    /// Sets the clock, also of programs that run.
    pub(crate) fn set(&self, offset_s: i64) {
        // In one go: a program may look just now.
        let next = self.offset.with_extension("next");
        fs::write(&next, offset_s.to_string()).unwrap();
        fs::rename(&next, &self.offset).unwrap();
    }

    /// The program runs by this clock.
    pub(crate) fn hold(&self, program: &mut Command) {
        program.env("LD_PRELOAD", &self.library).env("CLOCK_OFFSET_FILE", &self.offset);
    }
}

/// A library in C to be loaded before a program's own; none, said aloud, where there is no C compiler.
pub(crate) fn preloaded(bench: &Bench, name: &str, source: &str) -> Option<PathBuf> {
    let (source, library) = (bench.write(&format!("{name}.c"), source), bench.path(&format!("{name}.so")));
    let built = Command::new("cc").args(["-shared", "-fPIC", "-o"]).arg(&library).args([&source, "-ldl"]).status();
    if !built.is_ok_and(|status| status.success()) {
        println!("SKIPPED: no C compiler for {name}.c");
        return None;
    }
    Some(library)
}
