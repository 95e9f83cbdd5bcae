classdef system < trocar.operated
    % All arms at once, and the sounds: trocar.system().

    methods

        function self = system(varargin)
            % By a bridge as trocar.arm.
            self@trocar.operated('system', 'system', varargin{:});
        end

        function names = arms(self)
            % Names of its arms and setup joints: a cell array.
            row = self.state();
            names = row.arm(:).';
        end

        function result = power_on(self, timeout)
            % Enable every arm; trocar:refused says which are not and why.
            if nargin < 2, timeout = 10; end
            self.bridge.settle(self.name, 'power_on', '', timeout);
            result = true;
        end

        function result = home(self, timeout)
            % Home every arm, enabling those that are not.
            if nargin < 2, timeout = 60; end
            self.bridge.settle(self.name, 'home', '', timeout);
            result = true;
        end

        function result = power_off(self, timeout)
            % Disable every arm.
            if nargin < 2, timeout = 10; end
            self.bridge.settle(self.name, 'power_off', '', timeout);
            result = true;
        end

        function set_volume(self, volume)
            % Of beeps and speech, 0 to 1.
            self.command('set_volume', volume);
        end

        function result = volume(self)
            % The same.
            row = self.state();
            result = row.volume;
        end

        function beep(self, varargin)
            % Make a beep: how long (s), how high (Hz), how loud (0 to 1); what is not given is as usual.
            self.command('beep', [varargin{:}]);
        end

        function string_to_speech(self, text)
            % Say it.
            self.command('string_to_speech', [], text);
        end

    end

end
