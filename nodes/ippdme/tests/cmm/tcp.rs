//! The server of [`super::cmm`] on a port of this host: one connection at a time, and whatever else a test has it say.

#![allow(dead_code)] // Each test program uses another part.

use super::cmm::Cmm;
use std::io::{BufRead, BufReader, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread;
use std::time::{Duration, Instant};

/// The server and the connection that it has.
#[derive(Clone)]
pub(crate) struct Tcp {
    pub(crate) address: String,
    cmm: Arc<Mutex<Cmm>>,
    stream: Arc<Mutex<Option<TcpStream>>>,
}

impl Tcp {
    pub(crate) fn start(cmm: Cmm) -> Tcp {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let tcp = Tcp { address, cmm: Arc::new(Mutex::new(cmm)), stream: Arc::default() };
        let own = tcp.clone();
        thread::spawn(move || {
            for stream in listener.incoming().map(Result::unwrap) {
                *own.stream.lock().unwrap() = Some(stream.try_clone().unwrap());
                own.answer(stream);
            }
        });
        tcp
    }

    pub(crate) fn cmm(&self) -> MutexGuard<'_, Cmm> {
        self.cmm.lock().unwrap()
    }

    fn answer(&self, stream: TcpStream) {
        for line in BufReader::new(stream).split(b'\n') {
            let Ok(line) = line else { return };
            let line = String::from_utf8_lossy(&line).trim_end_matches('\r').to_owned();
            let answers: String = self.cmm().take(&line).into_iter().map(|answer| answer + "\r\n").collect();
            self.say(answers.as_bytes());
        }
    }

    /// Sends these bytes, if there is a connection.
    pub(crate) fn say(&self, bytes: &[u8]) {
        if let Some(stream) = self.stream.lock().unwrap().as_mut() {
            // The other side may be gone.
            let _ = stream.write_all(bytes);
        }
    }

    /// Ends the connection that there is.
    pub(crate) fn cut(&self) {
        if let Some(stream) = self.stream.lock().unwrap().take() {
            let _ = stream.shutdown(Shutdown::Both);
        }
    }

    /// Waits until the server has heard something that holds this so many times.
    pub(crate) fn wait_for(&self, times: usize, words: &str) {
        let since = Instant::now();
        while self.count(words) < times {
            assert!(since.elapsed() < Duration::from_secs(60), "{words} was not heard: {:?}", self.cmm().heard);
            thread::sleep(Duration::from_millis(5));
        }
    }

    pub(crate) fn count(&self, words: &str) -> usize {
        self.cmm().heard.iter().filter(|line| line.contains(words)).count()
    }
}
