//! Controllers, observer and delay line.

mod choices;
mod controllers;
mod delay_line;
mod jacobian;
mod landing;
mod observer;
mod observer_campaign;
mod observer_motion;
mod observer_rules;
mod regulation;
mod stress;
mod tracking;
mod tracking_loop;
mod tracking_uniqueness;
