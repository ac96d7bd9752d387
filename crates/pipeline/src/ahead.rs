//! Recorded readings, read ahead by a thread of their own: while a track works on one, the next is parsed. Order and contents are
//! those of the stream, so a replay's results do not depend on it.

use lumenav_core::ReadingStream;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::{self, JoinHandle};

/// Readings that may wait; what is kept in memory is so many and one more at each end.
const WAITING: usize = 16;

/// The same stream, read ahead. Where no thread can be had, the stream itself.
pub(crate) fn read_ahead(stream: ReadingStream) -> ReadingStream {
    let (sender, receiver) = sync_channel(WAITING);
    // The stream is handed over by a channel, so that it is not lost where the thread does not start.
    let (hand_over, taken) = sync_channel::<ReadingStream>(1);
    let reader = move || {
        let Ok(stream) = taken.recv() else { return };
        for item in stream {
            // Nobody listens any more: the replay has ended.
            if sender.send(item).is_err() {
                return;
            }
        }
    };
    match thread::Builder::new().name("readings".to_owned()).spawn(reader) {
        Ok(thread) => match hand_over.send(stream) {
            Ok(()) => Box::new(Ahead { receiver, thread: Some(thread) }),
            Err(unsent) => unsent.0,
        },
        Err(_) => stream,
    }
}

/// What the thread has read.
struct Ahead<T> {
    receiver: Receiver<T>,
    thread: Option<JoinHandle<()>>,
}

impl<T> Iterator for Ahead<T> {
    type Item = T;

    fn next(&mut self) -> Option<T> {
        if let Ok(item) = self.receiver.recv() {
            return Some(item);
        }
        // The thread has ended. If by a panic, this is no end of the file.
        if let Some(Err(panic)) = self.thread.take().map(JoinHandle::join) {
            std::panic::resume_unwind(panic);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lumenav_core::{ModalityError, Recorded};

    #[test]
    fn law_the_same_items_in_the_same_order_and_an_early_end_is_no_trouble() {
        let errors = || (0..200).map(|i| Ok(Recorded::Skipped(ModalityError::Reading(i.to_string()))));
        let text = |item: Result<Recorded, ModalityError>| format!("{item:?}");
        let expected: Vec<String> = errors().map(text).collect();
        let here: Vec<String> = read_ahead(Box::new(errors())).map(text).collect();
        assert_eq!(here, expected);
        let mut stream = read_ahead(Box::new(errors()));
        assert!(stream.next().is_some());
        drop(stream);
    }

    #[test]
    #[should_panic(expected = "the reader's own")]
    fn law_a_panic_of_the_reader_is_no_end_of_the_file() {
        let stream = std::iter::once_with(|| panic!("the reader's own"));
        read_ahead(Box::new(stream)).for_each(drop);
    }
}
