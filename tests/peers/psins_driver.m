% Runs PSINS' calibration functions (Yan Gongmin) on a table of rates and specific forces. Not part of the program: scripts/peers
% calls it under Octave beside a folder of PSINS, of which nothing is kept here. Needs Octave's package signal (PSINS calls fir1, filtfilt).
%
%   octave-cli psins_driver.m PSINS MODE RATES.csv REFERENCES.csv LATITUDE_DEG GRAVITY OUT
%
% MODE lsclbt: least squares against the commanded angles (REFERENCES.csv: T, raw angle, commanded angle, raw force, commanded force; x y z of
% each). sysclbt: that as the coarse calibration it asks for, then its Kalman filter with 43 states. mems: sysclbtMEMS, without references.
% OUT: as in imu_tk_driver.cpp. PSINS says w = Kg raw - eb - gSens f, f = Ka raw - db: M = K, b = inverse(K) times eb or db, S = gSens. Its Ka
% is lower triangular where judge.py has an upper one: judge.py turns every program's body frame alike.
% What only draws is replaced by nothing (a folder of ours before PSINS in the path); psinsenvi is what its installer would write.
arguments = argv();
[psins, mode, rates, references] = arguments{1:4};
latitude = str2double(arguments{5}) * pi / 180;
gravity = str2double(arguments{6});
output = arguments{7};
warning('off', 'all');
crash_dumps_octave_core(false);
pkg load signal
silent = tempname();
mkdir(silent);
for name = {'timebar', 'myfigure', 'myfig', 'xygo', 'subplot', 'plot', 'hold', 'resdisp'}
  file = fopen(fullfile(silent, [name{1} '.m']), 'w');
  fprintf(file, 'function varargout = %s(varargin)\n varargout = cell(1, nargout);\nend\n', name{1});
  fclose(file);
end
file = fopen(fullfile(silent, 'psinsenvi.m'), 'w');
fprintf(file, 'function [root, data, test] = psinsenvi()\n root = ''''; data = ''''; test = 0;\nend\n');
fclose(file);
addpath(genpath(fullfile(psins, 'base')));
addpath(silent);
confirm_recursive_rmdir(false);
glvs;
coarse.Kg = eye(3); coarse.Ka = eye(3); coarse.eb = zeros(3, 1); coarse.db = zeros(3, 1);
if ~strcmp(mode, 'mems')
  r = dlmread(references, ',', 1, 0);
  still = any(r(:, 11:13), 2);
  [coarse.Kg, coarse.eb] = lsclbt([r(:, 2:4), r(:, 1)], r(:, 5:7));
  [coarse.Ka, coarse.db] = lsclbt(r(still, 8:10), r(still, 11:13));
end
fine = struct('Kg', eye(3), 'Ka', eye(3), 'eb', zeros(3, 1), 'db', zeros(3, 1));
if ~strcmp(mode, 'lsclbt')
  table = dlmread(rates, ',', 1, 0);
  dt = mean(diff(table(:, 1)));
  w = table(:, 2:4) * coarse.Kg' - coarse.eb';
  f = table(:, 5:7) * coarse.Ka' - coarse.db';
  increments = [w * dt, f * dt, table(1, 1) + (0:rows(table) - 1)' * dt];
  if strcmp(mode, 'sysclbt')
    fine = sysclbt(increments, [latitude; 0; 0], gravity);
  else
    fine = sysclbtMEMS(increments, [latitude; 0; 0]);
  end
end
Mg = fine.Kg * coarse.Kg;
Ma = fine.Ka * coarse.Ka;
bg = Mg \ (fine.Kg * coarse.eb + fine.eb);
ba = Ma \ (fine.Ka * coarse.db + fine.db);
S = zeros(3);
if isfield(fine, 'gSens'), S = fine.gSens; end
if any(~isfinite([Mg(:); Ma(:); bg; ba; S(:)])), disp('PSINS did not converge: its result is not finite'); exit(2); end
file = fopen(output, 'w');
fprintf(file, '%.17g\n', Mg', bg, Ma', ba, S');
fclose(file);
rmpath(silent);
rmdir(silent, 's');
