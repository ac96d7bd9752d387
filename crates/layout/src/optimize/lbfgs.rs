//! Limited-memory BFGS with a backtracking line search (Nocedal and Wright, Numerical Optimization, 2006, algorithms 7.4 and 3.1).

use std::collections::VecDeque;

/// Pairs of steps and changes of the gradient that are remembered.
const MEMORY: usize = 12;
/// Armijo's share of the expected decrease.
const ARMIJO: f64 = 1e-4;
const HALVINGS: usize = 40;

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Minimises from `x`, which ends at the best point; its value. `f` writes the gradient and may be infinite.
pub(super) fn minimise(
    x: &mut Vec<f64>,
    steps: usize,
    tolerance: f64,
    stopped: &dyn Fn() -> bool,
    mut f: impl FnMut(&[f64], &mut [f64]) -> f64,
) -> f64 {
    let n = x.len();
    let (mut gradient, mut next_gradient) = (vec![0.0; n], vec![0.0; n]);
    let mut value = f(x, &mut gradient);
    let mut pairs: VecDeque<(Vec<f64>, Vec<f64>)> = VecDeque::new();
    let mut quiet = 0;
    for _ in 0..steps {
        if stopped() || !value.is_finite() {
            break;
        }
        let mut direction = descent(&gradient, &pairs);
        let mut slope = dot(&direction, &gradient);
        if slope.is_nan() || slope >= 0.0 {
            pairs.clear();
            direction = gradient.iter().map(|g| -g).collect();
            slope = dot(&direction, &gradient);
        }
        if slope == 0.0 {
            break;
        }
        // Without a memory the scale is unknown: a first step of a tenth.
        let mut length =
            if pairs.is_empty() { 0.1 / direction.iter().fold(0.0_f64, |m, d| m.max(d.abs())) } else { 1.0 };
        let mut accepted = None;
        for _ in 0..HALVINGS {
            let trial: Vec<f64> = x.iter().zip(&direction).map(|(x, d)| x + length * d).collect();
            let there = f(&trial, &mut next_gradient);
            if there <= value + ARMIJO * length * slope {
                accepted = Some((trial, there));
                break;
            }
            length *= 0.5;
        }
        let Some((trial, there)) = accepted else {
            if pairs.is_empty() {
                break;
            }
            pairs.clear();
            continue;
        };
        let step: Vec<f64> = trial.iter().zip(x.iter()).map(|(a, b)| a - b).collect();
        let change: Vec<f64> = next_gradient.iter().zip(&gradient).map(|(a, b)| a - b).collect();
        if dot(&step, &change) > 1e-12 * dot(&change, &change).sqrt() * dot(&step, &step).sqrt() {
            if pairs.len() == MEMORY {
                pairs.pop_front();
            }
            pairs.push_back((step, change));
        }
        quiet = if value - there <= tolerance * value.abs().max(1e-300) { quiet + 1 } else { 0 };
        *x = trial;
        value = there;
        std::mem::swap(&mut gradient, &mut next_gradient);
        if quiet == 5 {
            break;
        }
    }
    value
}

/// The two-loop recursion: minus the approximate inverse Hessian times the gradient.
fn descent(gradient: &[f64], pairs: &VecDeque<(Vec<f64>, Vec<f64>)>) -> Vec<f64> {
    let mut q: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let mut alphas = Vec::with_capacity(pairs.len());
    for (step, change) in pairs.iter().rev() {
        let alpha = dot(step, &q) / dot(step, change);
        q.iter_mut().zip(change).for_each(|(q, c)| *q -= alpha * c);
        alphas.push(alpha);
    }
    if let Some((step, change)) = pairs.back() {
        let scale = dot(step, change) / dot(change, change);
        q.iter_mut().for_each(|q| *q *= scale);
    }
    for ((step, change), alpha) in pairs.iter().zip(alphas.into_iter().rev()) {
        let beta = dot(change, &q) / dot(step, change);
        q.iter_mut().zip(step).for_each(|(q, s)| *q += (alpha - beta) * s);
    }
    q
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley in ten dimensions: the only minimum is at ones.
    #[test]
    fn closed_form_rosenbrock() {
        let mut x = vec![-1.2; 10];
        let value = minimise(&mut x, 2000, 1e-16, &|| false, |x, g| {
            g.fill(0.0);
            let mut sum = 0.0;
            for i in 0..x.len() - 1 {
                let (a, b) = (x[i + 1] - x[i] * x[i], 1.0 - x[i]);
                sum += 100.0 * a * a + b * b;
                g[i] += -400.0 * a * x[i] - 2.0 * b;
                g[i + 1] += 200.0 * a;
            }
            sum
        });
        assert!(value < 1e-10, "{value}");
        assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-4), "{x:?}");
    }

    #[test]
    fn law_stopped_keeps_where_it_is() {
        let mut x = vec![3.0];
        let value = minimise(&mut x, 100, 0.0, &|| true, |x, g| {
            g[0] = 2.0 * x[0];
            x[0] * x[0]
        });
        assert_eq!((value, x[0]), (9.0, 3.0));
    }
}
