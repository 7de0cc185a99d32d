//! The controls that a law has sent: the last ones, and those that do not act yet.

/// What was sent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SentControls {
    /// The last controls, none before the first tick.
    pub last: Option<Vec<f64>>,
    /// Those of as many ticks as the delay at most, the oldest first.
    pub queue: Vec<Vec<f64>>,
}

impl SentControls {
    /// Whether they are `r` finite controls each.
    pub(super) fn fits(&self, r: usize) -> bool {
        let fits = |u: &Vec<f64>| u.len() == r && u.iter().all(|it| it.is_finite());
        self.last.iter().chain(&self.queue).all(fits)
    }

    /// The last controls once more, 0 before any.
    pub(super) fn hold(&self, u: &mut [f64]) {
        match &self.last {
            Some(last) => u.copy_from_slice(last),
            None => u.fill(0.0),
        }
    }

    /// Remembers what is sent.
    pub(super) fn send(&mut self, u: &[f64], delay: usize) {
        self.last = Some(u.to_vec());
        if delay > 0 {
            if self.queue.len() == delay {
                self.queue.remove(0);
            }
            self.queue.push(u.to_vec());
        }
    }

    /// The controls of the periods until that of this tick acts, one after the other.
    pub(super) fn until(&self, delay: usize, r: usize) -> Vec<f64> {
        let mut controls = vec![0.0; r * (delay - self.queue.len())];
        self.queue.iter().for_each(|u| controls.extend_from_slice(u));
        controls
    }
}
