//! Progress on stderr: simulated time, speed, time left. Silent where stderr is no terminal.

use indicatif::{ProgressBar, ProgressStyle};
use lumenav::pipeline::{ObserverError, RunEvent, RunHeader, RunObserver};

/// Shows a bar (known duration) or a spinner (recorded data).
pub struct Progress {
    bar: Option<ProgressBar>,
    visible: bool,
}

impl Progress {
    /// A bar, or nothing at all.
    pub fn new(visible: bool) -> Self {
        Self { bar: None, visible }
    }
}

impl RunObserver for Progress {
    fn start(&mut self, header: &RunHeader) -> Result<(), ObserverError> {
        if !self.visible {
            return Ok(());
        }
        let (bar, template) = match header.duration_s {
            Some(duration) => (
                ProgressBar::new(duration.ceil() as u64),
                "{msg} {wide_bar} {pos}/{len} simulated s, {eta} left",
            ),
            None => (ProgressBar::new_spinner(), "{spinner} {msg} {pos} s of data"),
        };
        // The templates above are constants that parse; should they not, the default style does.
        bar.set_style(
            ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()),
        );
        bar.set_message(header.scenario.clone());
        self.bar = Some(bar);
        Ok(())
    }

    fn on(&mut self, event: &RunEvent<'_>) -> Result<(), ObserverError> {
        if let (Some(bar), RunEvent::Clock { at } | RunEvent::Unobserved { at }) = (&self.bar, event) {
            bar.set_position(at.seconds().max(0.0) as u64);
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), ObserverError> {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
        Ok(())
    }
}
