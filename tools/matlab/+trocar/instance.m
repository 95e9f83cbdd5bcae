classdef instance < handle
    % What arms and setup joints have in common: an operating state, and commands that change it.

    properties (SetAccess = protected)
        name    % as in the system's file
        bridge  % the trocar.bridge by which it is reached
    end

    methods

        function self = instance(name, varargin)
            % By a bridge: none (127.0.0.1:7380), 'HOST:PORT', 'HOST:PORT', 'token', or a trocar.bridge to share.
            self.name = name;
            self.bridge = trocar.internal.connection(varargin{:});
            trocar.internal.kind_of(self.bridge, name);
            self.bridge.read([name '/state']);
        end

        function result = connected(self)
            % Whether it shows fresh records.
            result = trocar.internal.is_shown(self.bridge, self.name);
        end

        function [state, timestamp] = operating_state(self)
            % DISABLED, ENABLED, PAUSED or FAULT, and when (s, of the robot's clock).
            row = self.state();
            state = row.state;
            timestamp = row.stamp_ns * 1e-9;
        end

        function state = desired_state(self)
            % The state that was asked for.
            row = self.state();
            state = row.desired_state;
        end

        function result = is_enabled(self)
            % Whether the arm is powered and not paused.
            result = strcmp(self.operating_state(), 'ENABLED');
        end

        function result = is_disabled(self)
            % Whether the arm has no power, or is on the way to it.
            result = strcmp(self.operating_state(), 'DISABLED');
        end

        function result = is_homed(self)
            % Whether the arm is homed and powered.
            row = self.state();
            result = logical(row.is_homed);
        end

        function result = is_busy(self)
            % Whether a move or a transition is in progress.
            row = self.state();
            result = logical(row.is_busy);
        end

        function state_command(self, word)
            % enable, disable, home, unhome, pause or resume; trocar:refused when it is not allowed now.
            self.bridge.command(self.name, 'state_command', [], word);
        end

        function result = enable(self, timeout)
            % Power on and wait until it is, `timeout` s (10) at most; trocar:refused says why it is not.
            if nargin < 2, timeout = 10; end
            state = self.operating_state();
            if strcmp(state, 'FAULT')
                self.bridge.settle(self.name, 'state_command', 'disable', timeout);
            end
            if ~strcmp(state, 'ENABLED')
                self.bridge.settle(self.name, 'state_command', 'enable', timeout);
            end
            result = true;
        end

        function result = disable(self, timeout)
            % Power off and wait until it is.
            if nargin < 2, timeout = 10; end
            self.bridge.settle(self.name, 'state_command', 'disable', timeout);
            result = true;
        end

        function result = home(self, timeout)
            % Enable where needed, home, and wait until it is homed, `timeout` s (60) at most.
            if nargin < 2, timeout = 60; end
            self.enable(timeout);
            self.bridge.settle(self.name, 'state_command', 'home', timeout);
            result = true;
        end

        function result = unhome(self, timeout)
            % Forget the homing and wait until it is forgotten.
            if nargin < 2, timeout = 10; end
            self.state_command('unhome');
            result = self.wait_for_homed(false, timeout);
        end

        function result = wait_for_operating_state(self, state, timeout)
            % Until that is its state; trocar:timeout after `timeout` s (10).
            if nargin < 3, timeout = 10; end
            self.wait_until(@() strcmp(self.operating_state(), state), timeout, ['is not ' state]);
            result = true;
        end

        function result = wait_for_homed(self, homed, timeout)
            % Until it is homed, or no longer is.
            if nargin < 3, timeout = 60; end
            words = {'is still homed', 'is not homed'};
            self.wait_until(@() self.is_homed() == homed, timeout, words{1 + logical(homed)});
            result = true;
        end

        function result = wait_for_busy(self, busy, timeout)
            % Until it is busy, or (not given: false) no longer is; trocar:timeout after `timeout` s (30).
            if nargin < 2, busy = false; end
            if nargin < 3, timeout = 30; end
            words = {'is still busy', 'is not busy'};
            self.wait_until(@() self.is_busy() == busy, timeout, words{1 + logical(busy)});
            result = true;
        end

        function result = wait_while_busy(self, timeout)
            % Until it is busy no longer.
            if nargin < 2, timeout = 30; end
            result = self.wait_for_busy(false, timeout);
        end

    end

    methods (Access = protected)

        function row = state(self)
            row = self.bridge.read([self.name '/state']);
        end

        function wait_until(self, done, timeout, what)
            trocar.internal.wait_until(done, self.bridge, self.name, timeout, [self.name ' ' what]);
        end

        function must_be(self, kind)
            found = trocar.internal.kind_of(self.bridge, self.name);
            if ~strncmp(found, kind, numel(kind))
                error('trocar:argument', '%s is of the kind %s, not %s', self.name, found, kind);
            end
        end

    end

end
