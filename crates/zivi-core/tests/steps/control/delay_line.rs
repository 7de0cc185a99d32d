//! Lines of delays against a queue of the standard library.

use std::collections::VecDeque;
use zivi_core::control::DelayLine;

/// The longest, as the setting says.
const MOST_DELAY: usize = 64;

#[test]
fn a_line_is_a_queue_of_fixed_length() {
    for periods in [0, 1, 2, 5, MOST_DELAY - 1, MOST_DELAY] {
        let mut line = DelayLine::new(periods, -1).unwrap();
        let mut queue = VecDeque::from(vec![-1; periods]);
        for value in 0..300 {
            assert!(line.held().eq(queue.iter().copied()), "{periods} {value}");
            assert_eq!(line.oldest(), queue.front().copied());
            queue.push_back(value);
            assert_eq!(line.push(value), queue.pop_front().unwrap());
        }
    }
    assert!(DelayLine::new(MOST_DELAY + 1, 0.0).is_err());
}
