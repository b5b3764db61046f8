# R's answers about r_trials.csv, as `name value` lines: Rscript r_answers.R > r_answers.txt
# Packages: sandwich (two-way variance); all else is base R.
library(sandwich)
folder <- dirname(sub("^--file=", "", grep("^--file=", commandArgs(), value = TRUE)))
d <- read.csv(file.path(folder, "r_trials.csv"))
say <- function(name, ...) for (value in c(...)) cat(name, sprintf("%.12g", value), "\n")

for (k in list(c(8, 10), c(0, 7), c(29, 36), c(1, 250))) {
  found <- suppressWarnings(prop.test(k[1], k[2], correct = FALSE))$conf.int
  say(sprintf("wilson_%d_%d", k[1], k[2]), found)
}
for (k in list(c(9, 1), c(5, 5), c(0, 4), c(3, 12))) {
  say(sprintf("mcnemar_%d_%d", k[1], k[2]), binom.test(k[1], sum(k))$p.value)
}
say("all_alike_5", binom.test(5, 5)$conf.int)
say("holm", p.adjust(c(0.03, 0.004, 0.2, 0.011), "holm"))

# Variance with participants and episodes random, and Satterthwaite's degrees of freedom of its parts
parts <- function(model, weights, scale = 1) {
  one <- function(cluster) {
    drop(weights %*% vcovCL(model, cluster = cluster, type = "HC0", cadjust = TRUE) %*% weights) * scale
  }
  cells <- interaction(d$participant, d$episode, drop = TRUE)
  v <- c(one(d$participant), one(d$episode), one(cells))
  df <- c(length(unique(d$participant)), length(unique(d$episode)), nlevels(cells)) - 1
  together <- one(d[, c("participant", "episode")])
  whole <- max(together, v)
  c(whole, max(whole^2 / sum(v^2 / df), min(df)))
}
of_mean <- function(name, model, weights, mean, on_logit) {
  v <- parts(model, weights)
  say(paste0(name, "_variance"), v[1])
  say(paste0(name, "_df"), v[2])
  half <- qt(0.975, v[2]) * sqrt(v[1])
  if (on_logit) {
    say(name, plogis(qlogis(mean) + c(-1, 1) * half / (mean * (1 - mean))))
  } else {
    say(name, mean + c(-1, 1) * half)
  }
}
of_mean("rate", lm(success ~ 1, d), 1, mean(d$success), TRUE)
of_mean("spl", lm(spl ~ 1, d), 1, mean(d$spl), FALSE)
by_split <- lm(success ~ 0 + split, d)
of_mean("total", by_split, rep(1 / 3, 3), mean(coef(by_split)), TRUE)

# Effect of memory within people and within episodes
for (name in c("success", "spl")) {
  d$value <- d[[name]]
  model <- lm(value ~ memory + participant + episode, d)
  k <- as.numeric(names(coef(model)) == "memory")
  v <- parts(model, k, nrow(d) / df.residual(model))
  effect <- coef(model)[["memory"]]
  half <- qt(0.975, v[2]) * sqrt(v[1])
  say(paste0("memory_", name), effect, effect - half, effect + half, 2 * pt(-abs(effect) / sqrt(v[1]), v[2]))
}

# Krippendorff's alpha by its coincidences, Gwet's AC1 by its pairs; labels of each episode's people
labels <- split(d$label, d$episode)
values <- sort(unique(d$label))
o <- matrix(0, length(values), length(values))
for (one in labels[lengths(labels) > 1]) {
  for (i in seq_along(one)) for (j in seq_along(one)) if (i != j) {
    at <- match(c(one[i], one[j]), values)
    o[at[1], at[2]] <- o[at[1], at[2]] + 1 / (length(one) - 1)
  }
}
n <- sum(o)
apart <- 1 - diag(length(values))
say("krippendorff", 1 - (n - 1) * sum(o * apart) / sum(outer(rowSums(o), rowSums(o)) * apart))
agree <- mean(sapply(labels[lengths(labels) > 1], function(one) mean(outer(one, one, "==")[!diag(length(one))])))
share <- rowMeans(sapply(labels, function(one) table(factor(one, values)) / length(one)))
chance <- sum(share * (1 - share)) / (length(values) - 1)
say("gwet", (agree - chance) / (1 - chance))
