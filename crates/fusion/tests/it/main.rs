//! Tests of the filter from outside: algebra against textbook forms, order of arrival, life of a belief, consistency.

mod algebra;
mod consistency;
mod hindsight;
mod iteration;
mod life;
mod models;
mod order;
mod refusal;
