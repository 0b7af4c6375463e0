//! Restricted Boltzmann machines: the start of a deep belief network.
//!
//! Place in the flow: rival in [`crate::compare()`], after Wang et al. 2022 (Robotics and Computer-Integrated Manufacturing 73):
//! layers are pretrained one after the other without targets, and the whole network is then trained on them. Method:
//! contrastive divergence with one step (Hinton 2002); the visible units of the first layer are positions scaled to 0..1,
//! taken as probabilities.

use crate::perceptron::{POSITION, Perceptron};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Hidden layers.
const WIDTHS: [usize; 2] = [64, 64];
/// Passes over the data for each layer.
const PASSES: usize = 30;
/// Step of contrastive divergence.
const RATE: f64 = 0.05;
/// Spread of the first weights.
const SPREAD: f64 = 0.1;

/// A network pretrained on positions in ±1, three numbers each.
pub(crate) fn pretrained(positions: &[f32], seed: u64) -> Perceptron {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut visible: Vec<Vec<f64>> =
        positions.chunks_exact(POSITION).map(|p| p.iter().map(|x| f64::from(*x) / 2.0 + 0.5).collect()).collect();
    let mut start = Vec::new();
    for (number, width) in WIDTHS.into_iter().enumerate() {
        let machine = Machine::train(&visible, width, &mut random);
        // The first layer learnt from (x + 1)/2, the network sees x: half the weights, and the other half into the bias.
        let halved = if number == 0 { 0.5 } else { 1.0 };
        start.extend(machine.weights.iter().flatten().map(|w| (w * halved) as f32));
        let shift =
            |h: usize| if number == 0 { machine.weights.iter().map(|row| row[h]).sum::<f64>() / 2.0 } else { 0.0 };
        start.extend((0..width).map(|h| (machine.hidden_bias[h] + shift(h)) as f32));
        visible = visible.iter().map(|v| machine.hidden(v)).collect();
    }
    Perceptron::belief(&WIDTHS, start)
}

/// One restricted Boltzmann machine; weights `[visible][hidden]`.
struct Machine {
    weights: Vec<Vec<f64>>,
    visible_bias: Vec<f64>,
    hidden_bias: Vec<f64>,
}

impl Machine {
    fn train(data: &[Vec<f64>], width: usize, random: &mut ChaCha8Rng) -> Machine {
        let inputs = data.first().map_or(0, Vec::len);
        let mut row = || (0..width).map(|_| random.random_range(-SPREAD..SPREAD)).collect();
        let mut machine = Machine {
            weights: (0..inputs).map(|_| row()).collect(),
            visible_bias: vec![0.0; inputs],
            hidden_bias: vec![0.0; width],
        };
        for _ in 0..PASSES {
            for visible in data {
                machine.step(visible, random);
            }
        }
        machine
    }

    fn hidden(&self, visible: &[f64]) -> Vec<f64> {
        let sum = |h: usize| visible.iter().zip(&self.weights).map(|(v, row)| v * row[h]).sum::<f64>();
        (0..self.hidden_bias.len()).map(|h| sigmoid(sum(h) + self.hidden_bias[h])).collect()
    }

    fn visible(&self, hidden: &[f64]) -> Vec<f64> {
        let sum = |row: &Vec<f64>| hidden.iter().zip(row).map(|(h, w)| h * w).sum::<f64>();
        self.weights.iter().zip(&self.visible_bias).map(|(row, bias)| sigmoid(sum(row) + bias)).collect()
    }

    fn step(&mut self, visible: &[f64], random: &mut ChaCha8Rng) {
        let hidden = self.hidden(visible);
        let drawn: Vec<f64> = hidden.iter().map(|p| f64::from(u8::from(random.random::<f64>() < *p))).collect();
        let dreamt = self.visible(&drawn);
        let echo = self.hidden(&dreamt);
        for (v, row) in self.weights.iter_mut().enumerate() {
            for (h, weight) in row.iter_mut().enumerate() {
                *weight += RATE * (visible[v] * hidden[h] - dreamt[v] * echo[h]);
            }
            self.visible_bias[v] += RATE * (visible[v] - dreamt[v]);
        }
        for (bias, (h, e)) in self.hidden_bias.iter_mut().zip(hidden.iter().zip(&echo)) {
            *bias += RATE * (h - e);
        }
    }
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_learns_to_reproduce_its_data() {
        // Two patterns: what is dreamt from either is nearer to it than to the other.
        let data: Vec<Vec<f64>> =
            (0..200).map(|k| if k % 2 == 0 { vec![0.9, 0.1, 0.9] } else { vec![0.1, 0.9, 0.1] }).collect();
        let machine = Machine::train(&data, 16, &mut ChaCha8Rng::seed_from_u64(1));
        for pattern in &data[..2] {
            let dreamt = machine.visible(&machine.hidden(pattern));
            for (d, p) in dreamt.iter().zip(pattern) {
                assert!((d - p).abs() < 0.25, "{dreamt:?} {pattern:?}");
            }
        }
    }

    #[test]
    fn a_pretrained_network_starts_from_its_machines_and_repeats() {
        let positions: Vec<f32> = (0..300).map(|k| (k as f32 * 0.7).sin()).collect();
        assert_eq!(pretrained(&positions, 2), pretrained(&positions, 2));
        assert_ne!(pretrained(&positions, 2), pretrained(&positions, 3));
    }
}
