//! The interface by which long work reports its progress.

/// Receives the progress of long work: the command line draws bars, tests ignore it.
pub trait Progress: Sync {
    /// Begins a step of `units` units of work; 0 if the number is not known.
    fn begin(&self, step: &str, units: u64);
    fn advance(&self, units: u64);
    fn end(&self);
    /// One sentence to the user.
    fn tell(&self, _sentence: &str) {}
}

/// Hears of the progress of a body, whose name it is given.
pub type Teller<'a> = &'a dyn Fn(&str) -> Box<dyn Progress + 'a>;

impl Progress for &dyn Progress {
    fn begin(&self, step: &str, units: u64) {
        (**self).begin(step, units);
    }

    fn advance(&self, units: u64) {
        (**self).advance(units);
    }

    fn end(&self) {
        (**self).end();
    }

    fn tell(&self, sentence: &str) {
        (**self).tell(sentence);
    }
}

/// Ignores all progress.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _step: &str, _units: u64) {}
    fn advance(&self, _units: u64) {}
    fn end(&self) {}
}
